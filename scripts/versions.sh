#!/usr/bin/env bash
# Run the quick tests with the lowest or the newest versions of the dependencies that setup.cfg allows, in an own
# environment: `scripts/versions.sh lowest-direct` or `scripts/versions.sh highest`. VENV names the environment
# (default: .venv-lowest-direct or .venv-highest), PYTHON the interpreter, TORCH the build of Torch to install first.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
resolution="${1:?lowest-direct or highest}"
shift
venv="${VENV:-.venv-$resolution}"
"${PYTHON:-python3}" -m venv "$venv"
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check uv
# A build of Torch for the CPU: the newest versions otherwise bring gigabytes of CUDA libraries.
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check "${TORCH:-$(grep '^torch==' constraints.txt)}"
"$venv/bin/python" -m pip freeze | grep '^torch' > "$venv/torch.txt"
"$venv/bin/python" -m uv pip install --quiet --python "$venv/bin/python" --resolution "$resolution" \
    --constraint "$venv/torch.txt" -e '.[test]'
"$venv/bin/python" -m uv pip list --python "$venv/bin/python" --quiet
export OMP_NUM_THREADS="${OMP_NUM_THREADS:-1}" OPENBLAS_NUM_THREADS="${OPENBLAS_NUM_THREADS:-1}"
"$venv/bin/python" -m pytest -n "${WORKERS:-2}" --dist loadfile "$@"
