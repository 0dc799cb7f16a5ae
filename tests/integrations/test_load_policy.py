"""`load_policy`: trained policies in a loop of one's own, on the task's own observations and actions."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

import safe_inspect
from safe_inspect.errors import ArgumentError, CheckpointError, SafeInspectError
from safe_inspect.evaluation.shipped import shipped_policy
from safe_inspect.experiments.modules.sources import Wanted, open_candidates

NAME = "translational-inspection"


@pytest.fixture(scope="module")
def policy():
    pytest.importorskip("onnxruntime")
    return safe_inspect.load_policy(NAME)


def test_it_wins_in_a_loop_of_its_own_task(policy):
    environment = policy.make_vec(16, autoreset_mode="SameStep")
    observations, _ = environment.reset(seed=1000)
    statuses = []
    while len(statuses) < 16:
        observations, _, terminated, truncated, infos = environment.step(policy.predict(observations))
        statuses += infos["final_info"]["status"][terminated | truncated].tolist() if "final_info" in infos else []
    assert np.mean(np.array(statuses) == 1) > 0.9


def test_one_observation_and_rows_of_them(policy):
    observations, _ = policy.make_vec(5).reset(seed=2)
    actions = policy.predict(observations)
    assert actions.shape == (5, 3)
    assert actions.dtype == np.int64
    np.testing.assert_array_equal(policy.predict(observations[3]), actions[3])
    assert policy.make().action_space.contains(policy.predict(observations[3]))
    with pytest.raises(ValueError, match=r"have the shape \(4,\); expected \(13,\) or \(N, 13\)"):
        policy.predict(observations[0, :4])


def test_the_onnx_file_and_the_checkpoint_agree(policy):
    cfg = "configs/translational-inspection/experiment.yml"
    other = safe_inspect.load_policy(shipped_policy(NAME).checkpoint, cfg)
    environment = policy.make_vec(8)
    observations, _ = environment.reset(seed=3)
    for _ in range(30):
        np.testing.assert_array_equal(policy.predict(observations), other.predict(observations))
        observations = environment.step(policy.predict(observations))[0]


@pytest.fixture(scope="module", params=["onnx", "torch"])
def either(request):
    if request.param == "torch":
        cfg = "configs/translational-inspection/experiment.yml"
        return safe_inspect.load_policy(shipped_policy(NAME).checkpoint, cfg)
    pytest.importorskip("onnxruntime")
    return safe_inspect.load_policy(NAME)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("drawn", [False, True])
def test_observations_that_are_not_finite_are_refused(either, bad, drawn):
    observations = np.zeros((3, 13))
    generator = np.random.default_rng(0) if drawn else None
    either.predict(observations, generator)
    observations[1, 4] = bad
    with pytest.raises(ArgumentError, match="NaN or infinity: element 4 of row 1 is"):
        either.predict(observations, generator)
    with pytest.raises(ArgumentError, match="NaN or infinity: element 4 of row 0 is"):
        either.predict(observations[1], generator)
    with pytest.raises(ArgumentError, match="NaN or infinity: element 4 of row 1 is"):  # as a rollout calls it
        either._policy(observations.astype(np.float32))


def test_an_argument_of_another_library_lists_what_is_taken(either):
    with pytest.raises(TypeError, match="unexpected keyword argument 'deterministic'; without `generator` it"):
        either.predict(np.zeros(13), deterministic=True)
    with pytest.raises(ArgumentError, match=r"`generator` is 0; give a numpy.random.Generator"):
        either.predict(np.zeros(13), 0)


def test_a_shipped_policy_flies_without_onnxruntime(monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "onnxruntime" else find(name))
    (candidate,) = open_candidates([NAME], Wanted())
    assert candidate.source["kind"] == "shipped"
    assert candidate.spec is candidate.experiment.spec


def test_what_cannot_be_loaded_is_reported():
    with pytest.raises(SafeInspectError, match="inspector: a scripted policy acts inside the environment"):
        safe_inspect.load_policy("inspector")
    with pytest.raises(CheckpointError, match="the policy is of another task"):
        safe_inspect.load_policy(NAME, "safe_inspect/TranslationalInspectionSeed-v0")
    with pytest.raises(SafeInspectError, match="blue0_ctrl, blue1_ctrl, blue2_ctrl have different policies"):
        safe_inspect.load_policy("multiagent-translational-inspection")
    with pytest.raises(SafeInspectError, match="it controls no agent 'blue7_ctrl'; did you mean"):
        safe_inspect.load_policy("multiagent-translational-inspection", agent="blue7_ctrl")
