"""An episode that safe-autonomy-sims recorded replays: states, counts, sun and each reward term at every step.

The record is test data of safe-autonomy-sims and not part of this repository. It is expected in the folder that the
environment variable SAFE_INSPECT_PARITY names, or else in `shared/parity` next to the repository.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from safe_inspect.dones import DoneStatus
from safe_inspect.environments import BatchedEnvironment, InspectionEnv, load_spec

EXPERIMENT = Path(__file__).parent / "recorded" / "experiment.yml"
FOLDER = Path(os.environ.get("SAFE_INSPECT_PARITY") or Path(__file__).parents[3] / "shared" / "parity")
RECORD = FOLDER / "translational_inspection.npz"
STATES = ("x", "y", "z", "x_dot", "y_dot", "z_dot")


def overrides(start: np.ndarray, sun_angle: float) -> list[str]:
    reset = "agent_config.blue0_ctrl.config.config.simulator_reset_parameters.config"
    given = [f"{reset}.{name}.config.value={value:.25f}" for name, value in zip(STATES, start, strict=True)]
    return [*given, f"additional_entities.sun.config.theta.config.value={sun_angle:.25f}"]


def test_the_variant_has_the_records_settings():
    """It loads and steps without the record too."""
    spec = load_spec(EXPERIMENT, overrides(np.array([0.0, 70.0, 0.0, 0.0, 0.0, 0.0]), 1.0))
    env = BatchedEnvironment(spec)
    observation = env.reset()[0, 0]
    assert env.simulation.world.points["chief"].num_points == 99
    np.testing.assert_allclose(observation[[0, 1, 2, 10]], [0.0, 70.0, 0.0, 1.0])
    np.testing.assert_allclose(env.step(np.ones((1, 1, 3))).terms["InspectionDeltaVReward"], [[-0.001 * 3 / 12 * 10]])


@pytest.mark.skipif(not RECORD.is_file(), reason=f"the recorded episode is not at {RECORD}; set SAFE_INSPECT_PARITY")
def test_the_recorded_episode_replays():
    with np.load(RECORD) as arrays:
        record = dict(arrays)
    start = np.concatenate((record["init_position"], record["init_velocity"]))
    spec = load_spec(EXPERIMENT, overrides(start, float(record["init_sun_angle"])))
    env = InspectionEnv(spec)
    names = [str(name) for name in record["obs_names"]]
    assert len(names) == len(set(names)) == 11
    first, info = env.reset(seed=spec.seed)
    inspected = record["obs"][:, 6].astype(int)
    assert info["inspected_count"] == int(record["obs0"][6])
    _agree(first, record["obs0"])
    steps = len(record["actions"])
    terms = [name.removeprefix("reward/") for name in record if name.startswith("reward/")]
    assert len(terms) == 4
    ended = False
    for step in range(steps):
        assert not ended, f"the replay ends before step {step}"
        observation, reward, terminated, truncated, info = env.step(record["actions"][step])
        _agree(observation, record["obs"][step])
        np.testing.assert_allclose(env.core.state.position[0, 0], record["obs"][step, :3], rtol=0, atol=1e-3)
        np.testing.assert_allclose(env.core.state.velocity[0, 0], record["obs"][step, 3:6], rtol=0, atol=1e-5)
        assert info["inspected_count"] == inspected[step]
        for name in terms:
            assert info[f"reward/{name}"] == pytest.approx(record[f"reward/{name}"][step], rel=1e-6, abs=1e-12), name
        assert reward == pytest.approx(record["reward_total"][step], rel=1e-6, abs=1e-12)
        ended = terminated or truncated
    assert terminated  # it leaves the range of 800 m
    assert info["status"] == DoneStatus.LOSE.name.lower()


def _agree(observation: np.ndarray, recorded: np.ndarray) -> None:
    """Compare what need agree; the direction of a cluster rests on scikit-learn's start from zero centres."""
    np.testing.assert_allclose(observation[:3], recorded[:3], rtol=0, atol=1e-3)
    np.testing.assert_allclose(observation[3:6], recorded[3:6], rtol=0, atol=1e-5)
    assert observation[6] == recorded[6]
    assert observation[10] == pytest.approx(recorded[10], abs=2e-6)
    assert np.linalg.norm(observation[7:10]) == pytest.approx(1.0, abs=1e-6)
