#!/usr/bin/env bash
# Set up, then run the tests that are quick. Arguments are passed on to pytest; all tests: -m 'slow or not slow'
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/setup.sh
"${VENV:-.venv}/bin/python" -m pytest "$@"
