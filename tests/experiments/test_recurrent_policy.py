"""Recurrent policies fly from a checkpoint and from its ONNX file: each row remembers its own episode, and no other."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from random_checkpoint import discrete, experiment_of, make_module, scaled, single_run

import safe_inspect
from safe_inspect.errors import ArgumentError, CheckpointError
from safe_inspect.evaluation.rollouts import rollout

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

NETS = {
    "separate": (None, {"lstm_cell_size": 8}),
    "shared": (discrete, {"lstm_cell_size": 12, "vf_share_layers": True, "head_fcnet_hiddens": [8]}),
    "scaled": (scaled, {"lstm_cell_size": 8, "fcnet_use_layernorm": True}),
}


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Return the folder of a run and its ONNX file, by the names of `NETS`."""
    from safe_inspect.experiments.export import export_policy

    made = {}
    for name, (change, model) in NETS.items():
        folder = tmp_path_factory.mktemp(name)
        checkpoint = single_run(folder, experiment_of(change), use_lstm=True, max_seq_len=5, **model)
        done = export_policy(checkpoint, folder / "p.onnx")
        assert 0.0 < done.difference.inputs < 2e-6
        made[name] = folder, done.path
    return made


@pytest.mark.parametrize(("name", "sampled"), [("separate", False), ("shared", True), ("scaled", None)])
def test_the_file_flies_as_the_checkpoint_does(exported, name, sampled):
    from safe_inspect.experiments.modules.sources import Wanted, open_candidates

    flown = []
    for source in exported[name]:
        (candidate,) = open_candidates([str(source)], Wanted(sampled=sampled, seed=5))
        flown += [rollout(candidate.spec, candidate.policies, 6, seed=2, num_envs=count, record=6) for count in (6, 4)]
    theirs = flown[0]
    assert theirs.delta_v.max() > 0.0
    for ours in flown[1:]:
        np.testing.assert_array_equal(ours.length, theirs.length)
        for one, other in zip(ours.trajectories, theirs.trajectories, strict=True):
            np.testing.assert_allclose(one.control, other.control, atol=2e-4)
    for one, other in zip(flown[2].trajectories, flown[3].trajectories, strict=True):
        np.testing.assert_array_equal(one.position, other.position)  # bit-identical, whatever else flies


@pytest.mark.parametrize("name", NETS)
def test_a_loop_begins_episodes_row_by_row(exported, name):
    """Environments of a vector begin episodes at different steps; each flies as it does alone."""
    policies = [safe_inspect.load_policy(source, overrides=["horizon=40"]) for source in exported[name]]
    alone = safe_inspect.load_policy(exported[name][0])
    environment = policies[0].make_vec(5, autoreset_mode="SameStep")
    observations, _ = environment.reset(seed=3)
    starts, seen, acted, began = np.ones(5, dtype=np.bool_), [], [], []
    for _ in range(60):
        actions, others = (policy.predict(observations, episode_start=starts) for policy in policies)
        np.testing.assert_allclose(others, actions, atol=2e-5)
        seen, acted, began = [*seen, observations], [*acted, actions], [*began, starts]
        observations, _, terminated, truncated, _ = environment.step(actions)
        starts = terminated | truncated
    assert (np.sum(began, axis=0) > 1).all()
    assert len({tuple(column) for column in np.transpose(began)}) > 1
    for row in range(5):
        wanted = [alone.predict(seen[k][row], episode_start=began[k][row]) for k in range(60)]
        np.testing.assert_allclose(np.stack(acted)[:, row], wanted, atol=2e-5)


@pytest.mark.parametrize("kind", [0, 1])
def test_an_episode_leaves_nothing_to_the_next(exported, kind):
    policy = safe_inspect.load_policy(exported["separate"][kind])
    observations = np.linspace(-1.0, 1.0, 22, dtype=np.float32).reshape(2, 11)
    first = policy.predict(observations, episode_start=True)
    second = policy.predict(observations, episode_start=False)
    assert np.abs(second - first).min(axis=1).max() > 1e-3
    third = policy.predict(observations, episode_start=np.array([True, False]))
    np.testing.assert_array_equal(third[0], first[0])
    assert np.abs(third[1] - second[1]).max() > 1e-3
    np.testing.assert_array_equal(policy.predict(observations, episode_start=True), first)


@pytest.mark.parametrize("kind", [0, 1])
def test_a_loop_that_does_not_say_where_episodes_begin_is_refused(exported, kind):
    policy = safe_inspect.load_policy(exported["separate"][kind])
    rows = np.zeros((3, 11), dtype=np.float32)
    with pytest.raises(ArgumentError, match="the policy is recurrent; give `episode_start`, True for each row whose"):
        policy.predict(rows)
    with pytest.raises(
        ArgumentError, match="there are 3 observations, but there were 0 in the last call; `episode_start` must be True"
    ):
        policy.predict(rows, episode_start=False)
    policy.predict(rows, episode_start=True)
    with pytest.raises(ArgumentError, match="there are 2 observations, but there were 3 in the last call"):
        policy.predict(rows[:2], episode_start=np.array([True, False]))
    for wrong in (np.ones(2, dtype=np.bool_), np.ones(3), [[True]]):
        with pytest.raises(
            ArgumentError,
            match=r"`episode_start` has the shape .*expected one bool or an array of bools of shape \(3,\)",
        ):
            policy.predict(rows, episode_start=wrong)


def test_the_file_says_what_it_keeps(exported):
    model = onnx.load(exported["shared"][1])
    told = {item.key: item.value for item in model.metadata_props}
    assert json.loads(told["state"]) == {"state_h": 12, "state_c": 12}
    assert told["format"] == "2"
    sizes = [
        [(item.name, item.type.tensor_type.shape.dim[1].dim_value) for item in part]
        for part in (model.graph.input, model.graph.output)
    ]
    assert sizes[0] == [("observation", 11), ("state_h", 12), ("state_c", 12)]
    assert sizes[1] == [("thrust", 3), ("action_dist_inputs", 13), ("next_state_h", 12), ("next_state_c", 12)]


def test_a_policy_without_a_state_has_a_file_as_before(tmp_path):
    from safe_inspect.experiments.export import export_policy

    model = onnx.load(export_policy(single_run(tmp_path / "run", experiment_of()), tmp_path / "p.onnx").path)
    told = {item.key: item.value for item in model.metadata_props}
    assert told["format"] == "1"
    assert "state" not in told
    assert [item.name for item in model.graph.input] == ["observation"]


def test_a_file_whose_state_is_another_is_not_left(tmp_path, monkeypatch):
    """The comparison sees a cell whose memory alone is wrong: the first step of an episode does not show it."""
    from safe_inspect.experiments import export
    from safe_inspect.experiments.export import export_policy

    def spoilt(net, info, title):
        import torch

        with torch.no_grad():
            net.module.encoder.actor_encoder.lstm.weight_hh_l0 += 1e-3
        return build(net, info, title)

    build = export.build_file
    monkeypatch.setattr(export, "build_file", spoilt)
    checkpoint = single_run(tmp_path / "run", experiment_of(), use_lstm=True, lstm_cell_size=8)
    with pytest.raises(CheckpointError, match="the exported policy differs from the given one"):
        export_policy(checkpoint, tmp_path / "p.onnx")
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_a_state_that_no_file_holds():
    import torch

    from safe_inspect.experiments.onnx_graph import RllibNet

    module = make_module(experiment_of().spec.agents[0], use_lstm=True, lstm_cell_size=8)
    assert RllibNet(module, "here").state == {"state_h": 8, "state_c": 8}
    for start in ({"h": torch.zeros(2, 8), "c": torch.zeros(2, 8)}, {"h": torch.zeros(1, 8)}):
        module.get_initial_state = lambda start=start: start
        with pytest.raises(CheckpointError, match="here: the policy has another state than RLlib's LSTM of one layer"):
            RllibNet(module, "here")


def test_the_documented_step_carries_the_state(exported):
    import onnxruntime

    from safe_inspect.evaluation.onnx_policy import load_onnx

    text = (Path(__file__).parents[2] / "docs" / "export.md").read_text(encoding="utf-8")
    names: dict = {}
    exec(next(part for part in text.split("```python\n")[1:] if "def step(" in part).partition("```")[0], names)
    file = exported["separate"][1]
    session, policy = onnxruntime.InferenceSession(file, providers=["CPUExecutionProvider"]), load_onnx(file)
    state = names["initial_state"](session.get_modelmeta().custom_metadata_map, 4)
    for observation in np.random.default_rng(0).normal(size=(5, 4, 11)).astype(np.float32):
        thrust, state = names["step"](session, observation, state)
        np.testing.assert_allclose(thrust, policy(observation), atol=1e-5)
