#!/usr/bin/env bash
# Set up, then train a policy of burns and coasts on translational inspection: two minutes after the installation.
# Arguments are passed on, for instance: bash scripts/demo.sh lr=1e-4
set -euo pipefail
unset PYTHONDONTWRITEBYTECODE
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/setup.sh
"${VENV:-.venv}/bin/python" -m safe_inspect.train_rl \
    --cfg configs/translational-inspection/experiment-burn-and-coast.yml \
    num_env_steps_sampled_lifetime=13000000 "$@"
echo "activate the environment for these commands: . ${VENV:-.venv}/bin/activate"
