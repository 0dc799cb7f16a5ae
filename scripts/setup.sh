#!/usr/bin/env bash
# Make the virtual environment .venv (or $VENV) with the package and all that it needs, in the versions of constraints.txt.
# PYTHON names the interpreter. A second call does nothing unless setup.cfg or constraints.txt has changed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
venv="${VENV:-.venv}"
state="$(cat setup.cfg pyproject.toml constraints.txt | cksum) $PWD"
if [ ! -f "$venv/.ready" ] || [ "$(cat "$venv/.ready")" != "$state" ]; then
    echo "Installing into $venv (a few minutes the first time) ..." >&2
    "${PYTHON:-python3}" -m venv "$venv"
    # Python compiles a module when it is first imported; to compile all of them now would take half of the time. Callers
    # see to it that the result is kept (PYTHONDONTWRITEBYTECODE): else each process of Ray takes 4 s more to start.
    (while sleep 15; do echo "  still installing, $SECONDS s" >&2; done) &
    trap "kill $!" EXIT
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt -e '.[dev]'
    echo "$state" > "$venv/.ready"
    echo "Ready: $venv/bin/python" >&2
fi
