#!/usr/bin/env bash
# Set up, then run the tests. Arguments are passed on to pytest, for instance: bash scripts/test.sh -m 'not slow'
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/setup.sh
"${VENV:-.venv}/bin/python" -m pytest "$@"
