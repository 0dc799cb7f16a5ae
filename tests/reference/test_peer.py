"""The small simulation is the reference of parity: it replays the recorded episode, and the variant agrees with it."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from safe_inspect.environments import InspectionEnv, load_spec

from .one_deputy import PEER, TERMS, OneDeputy

EXPERIMENT = Path(__file__).parents[1] / "parity" / "recorded" / "experiment.yml"
FOLDER = Path(os.environ.get("SAFE_INSPECT_PARITY") or Path(__file__).parents[3] / "shared" / "parity")
RECORD = FOLDER / "translational_inspection.npz"


@pytest.mark.skipif(not RECORD.is_file(), reason=f"the recorded episode is not at {RECORD}; set SAFE_INSPECT_PARITY")
def test_it_replays_the_recorded_episode():
    """Within 2.1e-5 m and 1.1e-7 m/s, the differences that docs/parity.md gives for the package."""
    with np.load(RECORD) as arrays:
        record = dict(arrays)
    deputy = OneDeputy(PEER)
    flight = deputy.reset(record["init_position"], record["init_velocity"], float(record["init_sun_angle"]))
    for step, action in enumerate(record["actions"]):
        assert flight.status == "running", f"the replay ends before step {step}"
        deputy.step(action)
    assert flight.status == "lose"
    found, recorded = np.array(flight.observation), np.concatenate((record["obs0"][None], record["obs"]))
    np.testing.assert_allclose(found[:, :3], recorded[:, :3], rtol=0, atol=2.1e-5)
    np.testing.assert_allclose(found[:, 3:6], recorded[:, 3:6], rtol=0, atol=1.1e-7)
    np.testing.assert_array_equal(found[:, 6], recorded[:, 6])
    np.testing.assert_allclose(found[10:, 7:10], recorded[10:, 7:10], rtol=0, atol=1e-7)  # clusters: from step 10 on
    np.testing.assert_allclose(found[:, 10], recorded[:, 10], rtol=0, atol=2e-7)
    for name in TERMS:
        terms = [terms[name] for terms in flight.terms]
        np.testing.assert_allclose(terms, record[f"reward/{name}"], rtol=1e-12, atol=1e-15)
    rewards = [sum(terms.values()) for terms in flight.terms]
    np.testing.assert_allclose(rewards, record["reward_total"], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("strength", [0.03, 1.0])
def test_the_variant_flies_as_it_does(strength):
    """With the settings of safe-autonomy-sims, without its record."""
    names = ("x", "y", "z", "x_dot", "y_dot", "z_dot")
    state, sun = np.array([31.0, -52.0, 24.0, 0.12, -0.05, -0.08]), 5.9
    reset = "agent_config.blue0_ctrl.config.config.simulator_reset_parameters.config"
    given = [f"{reset}.{name}.config.value={value}" for name, value in zip(names, state, strict=True)]
    env = InspectionEnv(load_spec(EXPERIMENT, [*given, f"additional_entities.sun.config.theta.config.value={sun}"]))
    first, info = env.reset(seed=2)
    deputy = OneDeputy(PEER)
    flight = deputy.reset(state[:3], state[3:], sun, int(env.core.state.key[0]))
    np.testing.assert_allclose(first, flight.observation[0], rtol=2e-7, atol=2e-7)
    generator, over = np.random.default_rng(7), False
    for _ in range(400):
        action = strength * generator.uniform(-1.0, 1.0, 3).astype(np.float32)
        observation, reward, terminated, _, info = env.step(action)
        deputy.step(action)
        np.testing.assert_allclose(observation, flight.observation[-1], rtol=2e-7, atol=2e-6)
        for name, value in flight.terms[-1].items():
            assert info[f"reward/{name}"] == pytest.approx(value, rel=1e-12, abs=1e-15)
        assert reward == pytest.approx(sum(flight.terms[-1].values()), rel=1e-12, abs=1e-15)
        assert (info["status"], info["inspected_count"]) == (flight.status, flight.count)
        over = terminated
        if over:
            break
    assert over
