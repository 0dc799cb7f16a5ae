#!/usr/bin/env bash
# Print the branches of rta, dynamics and simulators that the tests do not take. Half an hour.
# Compiled code is measured with compilation off, where a test that is too slow then is cut off; what needs machine code
# (functions that are called by their address) is run compiled, which measures only what is around it.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/setup.sh
python="${VENV:-.venv}/bin/python"
data="$(mktemp -d)"
trap 'rm -rf "$data"' EXIT
export OMP_NUM_THREADS=1 PYTHONPATH=scripts
measure="$python -m coverage run --branch --source=safe_inspect/rta,safe_inspect/dynamics,safe_inspect/simulators"
measure="$measure --data-file=$data/part -p -m pytest -q -p no:cacheprovider -n 0"
for file in tests/dynamics/test_*.py tests/simulators/test_*.py tests/rta/test_*.py; do
    NUMBA_DISABLE_JIT=1 $measure -p time_limit "$file" > /dev/null || true
    echo "$file"
done
for room in rta simulators environments tasks contract evaluation rendezvous golden; do
    $measure "tests/$room" > /dev/null
    echo "tests/$room, compiled"
done
"$python" -m coverage combine -q --data-file="$data/all" "$data"/part.*
"$python" -m coverage report --data-file="$data/all" --show-missing --skip-covered
