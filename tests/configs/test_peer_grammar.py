"""Files in the grammar of safe-autonomy-sims: its paths of functors, its keys without effect, `!include-extend`."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.config.loading.loader import load
from safe_inspect.environments import BatchedEnvironment, TeamEnvironment
from safe_inspect.environments.layout import action_layout
from safe_inspect.errors import ConfigError
from safe_inspect.experiments.runs.training_run import read_settings

FILES = Path(__file__).parent / "peer_grammar"


@pytest.fixture
def experiment(tmp_path: Path) -> Path:
    shutil.copytree(FILES, tmp_path / "files")
    return tmp_path / "files" / "experiment.yml"


def test_docking_in_the_grammar_of_safe_autonomy_sims_is_docking(experiment):
    theirs = load_experiment(experiment)
    ours = load_experiment(configs_root() / "docking" / "experiment.yml")
    environments = [BatchedEnvironment(each.spec, 8, seed=4) for each in (ours, theirs)]
    first, second = (env.reset() for env in environments)
    np.testing.assert_allclose(first, second, rtol=1e-6)
    generator = np.random.default_rng(2)
    for _ in range(100):
        thrust = generator.uniform(-1.0, 1.0, (8, 1, 3))
        one, other = (env.step(thrust) for env in environments)
        np.testing.assert_allclose(one.observation, other.observation, rtol=1e-6)
        np.testing.assert_allclose(one.reward, other.reward, rtol=1e-12, atol=1e-15)
        np.testing.assert_array_equal(one.status, other.status)


def test_six_dof_inspection_in_the_grammar_of_safe_autonomy_sims_is_six_dof_inspection():
    theirs = load_experiment(FILES / "six_dof" / "experiment.yml")
    ours = load_experiment(configs_root() / "weighted-six-dof-inspection" / "experiment.yml")
    environments = [BatchedEnvironment(each.spec, 8, seed=4) for each in (ours, theirs)]
    first, second = (env.reset() for env in environments)
    assert first.shape == (8, 1, 37)
    np.testing.assert_allclose(first, second, rtol=1e-5, atol=1e-6)
    generator = np.random.default_rng(2)
    for _ in range(30):
        action = generator.uniform(-1.0, 1.0, (8, 1, 6)) * np.repeat([0.1, 1.0], 3)
        one, other = (env.step(action) for env in environments)
        np.testing.assert_allclose(one.observation, other.observation, rtol=1e-5, atol=1e-6)
        for name in one.terms:
            np.testing.assert_allclose(one.terms[name], other.terms[name], rtol=1e-12, atol=1e-15)
        np.testing.assert_array_equal(one.status, other.status)


POSITION = "initializer: {functor: safe_autonomy_sims.simulators.initializers.cwh.PositionVelocityInitializer}\n"
OLDER = {
    "the sun of safe-autonomy-simulation": ("inspection.sun.Sun", "inspection.sun_model.SunEntity"),
    "the sun of safe-autonomy-dynamics": (
        "safe_autonomy_simulation.sims.inspection.sun.Sun", "safe_autonomy_dynamics.cwh.sun_model.SunEntity",
    ),
    "a chief without an initialiser": (f"      {POSITION}", ""),
}  # fmt: skip


def changed(path: Path, new: str, older: str) -> Path:
    text = path.read_text()
    assert text.count(new) == 1
    path.write_text(text.replace(new, older))
    return path.parent / "experiment.yml"


@pytest.mark.parametrize(("new", "older"), OLDER.values(), ids=OLDER)
def test_older_files_say_the_same(tmp_path, new, older):
    shutil.copytree(FILES / "six_dof", tmp_path / "six_dof")
    experiment = changed(tmp_path / "six_dof" / "environment.yml", new, older)
    assert load_experiment(experiment).spec == load_experiment(FILES / "six_dof" / "experiment.yml").spec


def test_a_body_of_no_kind_is_named(experiment):
    environment = experiment.parent / "environment.yml"
    changed(environment, "      platform: cwh\n", "")
    changed(environment, f"      {POSITION}", "")
    with pytest.raises(ConfigError, match="a body needs a `platform` or an `initializer`"):
        load_experiment(experiment)


def test_three_deputies_that_turn_in_the_grammar_of_safe_autonomy_sims_see_22_numbers():
    spec = load_experiment(FILES / "six_dof_team" / "experiment.yml").spec
    env = TeamEnvironment(spec, 4, seed=4)
    first = env.reset()[0]
    assert first.shape == (4, 3, 22)
    assert action_layout(spec.agents[0]).high.tolist() == [1.0, 1.0, 1.0, 0.001, 0.001, 0.001]  # moments as they are
    generator = np.random.default_rng(2)
    for _ in range(10):
        action = generator.uniform(-1.0, 1.0, (4, 3, 6)) * np.repeat([0.05, 1e-4], 3)
        found = env.step([action]).groups[0]
    state, points = env.state, env.state.points["chief"]
    of_blue0 = [array[:, :1].repeat(3, axis=1)[..., None] for array in (points.own_count / 100, points.own_score)]
    of_all = [array[:, None].repeat(3, axis=1) for array in (state.sun_angle[:, None], state.priority_vector)]
    uninspected = found.observation[..., 7:10]
    expected = [
        state.position[:, :3] / 100, state.velocity[:, :3] / 0.5, of_blue0[0], uninspected, *of_all, of_blue0[1],
        state.orientation[:, :3], state.angular_velocity[:, :3] / 0.05,
    ]  # fmt: skip
    np.testing.assert_allclose(found.observation, np.concatenate(expected, axis=-1), rtol=1e-6, atol=1e-7)
    assert (uninspected == uninspected[:, :1]).all()  # all observe where blue0 should look
    assert list(found.terms) == [
        "ObservedPointsReward", "SafeInspectionSuccessReward", "InspectionCrashReward", "InspectionDeltaVReward",
    ]  # fmt: skip
    shared = [type(item.functor).__name__ for item in spec.shared_dones]
    assert shared == ["CollisionDoneFunction", "MultiagentSuccessDoneFunction", "SetAllDoneFunction"]


def test_the_environments_horizon_holds_and_the_other_is_noted(experiment):
    theirs = load_experiment(experiment)
    limits = {named.name: named.functor for named in theirs.spec.agents[0].dones}
    assert limits["EpisodeLengthDone"].horizon == 1223
    task = theirs.config.config.config
    notes = read_settings({"algorithm": "PPO", **theirs.rllib}, task.tune_config, task.ray_config, ()).notes
    assert any("`horizon` has no effect" in note for note in notes)


def test_items_keep_their_places(experiment):
    path = experiment.parent / "controllers.yml"
    path.write_text(path.read_text().replace("Y Thrust", "Y Thrst"))
    with pytest.raises(ConfigError, match=r"controllers\.yml:2 .*Y Thrst"):
        load_experiment(experiment)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: !include-extend ./list.yml", "can only be an item of a list"),
        ("a: [!include-extend ./mapping.yml]", "needs a file that contains a list"),
        ("a: [!include-extend ./nowhere.yml]", "does not exist"),
        ("a: [!include-extend '']", "needs a file that contains a list"),
    ],
)
def test_a_wrong_extension_is_named(tmp_path, text, words):
    (tmp_path / "list.yml").write_text("[1, 2]")
    (tmp_path / "mapping.yml").write_text("{b: 1}")
    (tmp_path / "file.yml").write_text(text)
    with pytest.raises(ConfigError, match=words):
        load(tmp_path / "file.yml")


def test_items_of_a_file_are_in_the_list(tmp_path):
    (tmp_path / "list.yml").write_text("[1, {b: 2}]")
    (tmp_path / "file.yml").write_text("a: [0, !include-extend ./list.yml, 3, !include-extend ./list.yml]")
    assert load(tmp_path / "file.yml") == {"a": [0, 1, {"b": 2}, 3, 1, {"b": 2}]}
