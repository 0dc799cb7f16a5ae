#!/usr/bin/env bash
# Set up, then run the tests that are quick, in two processes. Arguments are passed on to pytest: -m 'not long' runs
# those of continuous integration, -m '' all. WORKERS=0 runs them in one process, as a debugger wants.
set -euo pipefail
unset PYTHONDONTWRITEBYTECODE
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/setup.sh
# Two processes on two cores: threads of the linear algebra would only wait for each other.
export OMP_NUM_THREADS="${OMP_NUM_THREADS:-1}" OPENBLAS_NUM_THREADS="${OPENBLAS_NUM_THREADS:-1}"
"${VENV:-.venv}/bin/python" -m pytest -n "${WORKERS:-2}" --dist loadfile --no-loadscope-reorder "$@"
