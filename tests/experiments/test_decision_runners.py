"""Decisions that last, through RLlib: their episodes do not depend on the number of environment runners."""

from __future__ import annotations

import numpy as np
import pytest
from algorithms import parts_of

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.experiments.settings.policies import DEFAULT_MAKER

pytestmark = [pytest.mark.ray, pytest.mark.slow]

FILE = "experiment-burn-and-coast.yml"
#: Control steps of each environment in the calls: decisions continue from one call to the next, and episodes end.
CALLS = (7, 60, 41)
MODEL = {"fcnet_hiddens": [32, 32], "orthogonal": True, "initial_burn_probability": 0.5, "initial_std": 0.3}


def decisions(algo):
    """Return what the runners sample by agent and episode: observations, actions, densities, rewards and steps."""
    remote = algo.config.num_env_runners > 0

    def sample(runner):
        return [runner.sample(num_timesteps=steps * runner.num_envs) for steps in CALLS]

    found = {}
    for calls in algo.env_runner_group.foreach_env_runner(sample, local_env_runner=not remote):
        for part in (part for episodes in calls for part in parts_of(episodes)):
            outputs = (part.get_extra_model_outputs(name) for name in ("action_logp", "decision_steps"))
            arrays = (part.get_observations()[:-1], part.get_actions(), part.get_rewards(), *outputs)
            rows = np.column_stack([np.asarray(array).reshape(len(part), -1) for array in arrays])
            end = np.array([part.is_terminated, part.is_truncated])
            pieces = found.setdefault((part.agent_id, part.multi_agent_episode_id or part.id_), [])
            pieces.append((part.t_started, rows, end, part.get_observations()[-1]))
    return found


@pytest.mark.parametrize(
    ("folder", "overrides"),
    [
        pytest.param("translational-inspection", (), id="one"),
        pytest.param(
            "multiagent-translational-inspection",
            ("env_config.rta.config.enabled=False",),
            id="team",
            marks=pytest.mark.long,
        ),
    ],
)
def test_decisions_do_not_depend_on_the_number_of_runners(algorithm, folder, overrides):
    experiment = load_experiment(configs_root() / folder / FILE, ("horizon=50", *overrides))
    streams = [
        decisions(
            algorithm(
                experiment.resolved,
                DEFAULT_MAKER,
                tuple(experiment.policies.values()),
                num_env_runners=runners,
                num_envs_per_env_runner=envs,
                model_config=MODEL,
            )
        )
        for runners, envs in ((0, 4), (2, 2))
    ]
    lasting = np.concatenate([rows[:, -1] for pieces in streams[0].values() for _, rows, _, _ in pieces])
    assert len(np.unique(lasting)) > 3
    assert any(end.any() for pieces in streams[0].values() for _, _, end, _ in pieces)
    assert any(len(pieces) > 1 for pieces in streams[0].values())
    for other in streams[1:]:
        assert other.keys() == streams[0].keys()
        for name, pieces in streams[0].items():
            for wanted, found in zip(pieces, other[name], strict=True):
                for one, same in zip(wanted, found, strict=True):
                    np.testing.assert_array_equal(one, same)
