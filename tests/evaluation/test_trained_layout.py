"""A policy flies only with the observation and the action of its training: checkpoints and ONNX files agree."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

EXPERIMENTS = Path(__file__).parents[1] / "experiments"
if str(EXPERIMENTS) not in sys.path:
    sys.path.insert(0, str(EXPERIMENTS))

from random_checkpoint import TEAM, discrete, experiment_of, make_module, save_run, scaled, single_run  # noqa: E402

from safe_inspect.cli.main import main  # noqa: E402
from safe_inspect.errors import CheckpointError  # noqa: E402
from safe_inspect.evaluation.policy_file import PolicyInfo, check_layout  # noqa: E402
from safe_inspect.experiments.modules.sources import open_source  # noqa: E402
from safe_inspect.experiments.settings.policies import policy_info  # noqa: E402
from safe_inspect.glues.base import ActionGlue, ObservationGlue  # noqa: E402
from safe_inspect.glues.normalizers import Normalizer  # noqa: E402
from safe_inspect.plugins.registry import registry  # noqa: E402

pytest.importorskip("onnx")

AGENT = "agent_config.0.config.config"
CONTROLS = f"{AGENT}.glues.0.wrapped"
CHANGES = {"plain": None, "scaled": scaled, "discrete": discrete}


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    """Return checkpoint and ONNX file of each task."""
    made = {}
    for name, change in CHANGES.items():
        folder = tmp_path_factory.mktemp(name)
        made[name] = [str(single_run(folder / "run", experiment_of(change))), str(folder / "p.onnx")]
        assert main(["export", made[name][0], "--output", made[name][1]]) == 0
    return made


def part(name):
    """Return the path of a part's properties in the configuration."""
    parts = experiment_of().resolved["agent_config"][0]["config"]["config"]["parts"]
    index = next(index for index, item in enumerate(parts) if item.get("config", {}).get("name") == name)
    return f"{AGENT}.parts.{index}.config"


def refused(source, overrides):
    """Return why a source is refused, after its name."""
    with pytest.raises(CheckpointError) as caught:
        open_source(source, None, overrides)
    return str(caught.value).removeprefix(f"{source}: ")


@pytest.mark.parametrize(
    ("task", "overrides", "shown"),
    [
        ("discrete", [f"{CONTROLS}.0.config.levels=[-0.2 N, 0 N, 0.2 N]"],
         "in the action of blue0_ctrl, X Thrust has the levels [-0.1, 0, 0.1] N in training and has the levels "
         "[-0.2, 0, 0.2] N in the task"),
        ("discrete", [f"{CONTROLS}.0.config.levels=[-0.1, 0, 0.05, 0.1]"], "and has the levels [-0.1, 0, 0.05, 0.1] N"),
        ("plain", ["PART.properties={name: x_thrust, low: -2, high: 2}"],
         "X Thrust commands 0 + 1 a within [-1, 1] N in training and commands 0 + 1 a within [-2, 2] N in the task"),
        ("plain", ["PART.properties={name: x_thrust, low: -100, high: 100, units: mN}"], "within [-0.1, 0.1] N in the"),
        ("plain", ["PART.axis=2"], "X Thrust acts along x in training and along z in the task"),
        ("plain", [f"{CONTROLS}.0.config.normalization={{normalizer: LinearNormalizer, config: {{maximum: 2.0}}}}"],
         "X Thrust commands 0 + 1 a within"),
        ("plain", [f"{AGENT}.glues.1.config.normalization.config.sigma=[7, 7, 7]"],
         "in the observation of blue0_ctrl, Sensor_Position.x is seen as (value - 0) / 100 in training and is seen as "
         "(value - 0) / 7 in the task"),
        ("scaled", [f"{AGENT}.glues.1.config.normalization.config.mu=[0.2, 0, -0.05]"],
         "(value - 100) / 100 in training and is seen as (value - 200) / 100 in the task"),
        ("plain", [f"{AGENT}.glues.2.config.output_units=cm/s"], "Sensor_Velocity.v_x is seen as"),
    ],
)  # fmt: skip
def test_another_observation_or_action_is_refused(sources, task, overrides, shown):
    overrides = [override.replace("PART", part("X Thrust")) for override in overrides]
    checkpoint, file = (refused(source, overrides) for source in sources[task])
    assert shown in checkpoint
    assert checkpoint == file
    assert "use the glues and controllers of its training" in file


@pytest.mark.parametrize("task", CHANGES)
def test_the_same_in_other_words_is_flown(sources, task):
    overrides = ["horizon=7"]
    if task == "discrete":
        overrides.append(f"{CONTROLS}.0.config.levels=[-100 mN, 0, 0.1 N]")
    elif task == "plain":
        overrides.append(f"{part('X Thrust')}.properties={{name: x_thrust, low: -1000, high: 1000, units: mN}}")
    for source in sources[task]:
        assert open_source(source, None, overrides)[1] is not None


def test_other_levels_as_a_user_types_them(sources, capsys):
    levels = f"{CONTROLS}.0.config.levels=[-0.2 N, 0 N, 0.2 N]"
    for source in sources["discrete"]:
        for words in (["evaluate", source, "--episodes", "2"], ["draw", source], ["compare", source, "random"]):
            assert main([*words, levels]) == 2
            assert "X Thrust has the levels [-0.1, 0, 0.1] N in training" in capsys.readouterr().err
    experiment = str(Path(sources["discrete"][0]).parents[3] / "experiment.resolved.yml")
    assert main(["export", sources["discrete"][0], "--cfg", experiment, "--output", "no/where.onnx", levels]) == 2
    assert "X Thrust has the levels [-0.1, 0, 0.1] N in training" in capsys.readouterr().err


def test_agents_are_compared_with_the_policy_that_flies_them(tmp_path):
    experiment = experiment_of(path=TEAM)
    agents = experiment.spec.agents
    modules = {agent.policy: make_module(agent, seed) for seed, agent in enumerate(agents)}
    checkpoint = save_run(tmp_path / "run", experiment, modules)
    other = "agent_config.0.config.config.glues.1.config.normalization.config.sigma=[7, 7, 7]"
    assert f"in the observation of {agents[0].name}, " in refused(checkpoint, [other])


class TestForeignPlugins:
    """Plugins of others are compared by their configuration, for what they compute is not known here."""

    @pytest.fixture(autouse=True)
    def plugins(self):
        before = {kind: dict(known) for kind, known in registry._classes.items()}

        class Cubed(Normalizer):
            """x^3 times a factor."""

            factor: float = 1.0

            def __call__(self, values, low, high):
                return self.factor * values**3

            def inverse(self, values, low, high):
                return np.cbrt(values / self.factor)

        class Bias(ObservationGlue):
            """A number."""

            value: float = 0.5

            def names(self, parts):
                return ("bias",)

            def bounds(self, parts):
                return np.zeros(1), np.ones(1)

            def __call__(self, view):
                return np.full((view.num_rows, 1), self.value)

        class Puffs(ActionGlue):
            """Puffs along x."""

            size: float = 0.1

            def names(self, parts):
                return ("puff",)

            def bounds(self, parts):
                return np.zeros(1), np.ones(1)

            def choices(self, parts):
                return (2,)

            def __call__(self, action, parts):
                return np.concatenate((self.size * action, np.zeros((len(action), 2))), axis=1)

        yield
        for kind in list(registry._classes):
            registry._classes[kind] = before.get(kind, {})

    @pytest.mark.parametrize(
        ("holder", "key", "plugin"),
        [
            (lambda agent: agent["glues"][2]["config"], "normalization",
             {"normalizer": "Cubed", "config": {"factor": 2.0}}),
            (lambda agent: agent["glues"], 4, {"functor": "Bias", "config": {"value": 2.0}}),
            (lambda agent: agent["glues"][0], "wrapped", [{"functor": "Puffs", "config": {"size": 2.0}}]),
        ],
        ids=["normaliser", "observation", "action"],
    )  # fmt: skip
    def test_a_changed_plugin_is_refused(self, holder, key, plugin):
        def with_plugin(number):
            def change(agent):
                holder(agent)[key] = json.loads(json.dumps(plugin).replace("2.0", number))

            return experiment_of(change)

        one, other, none = with_plugin("2.0"), with_plugin("3.0"), experiment_of()
        info = policy_info(one, "default_policy", one.spec.agents)
        info = PolicyInfo.of(info.metadata())  # as it is written in a file
        check_layout("here", info, one.spec.agents[0])
        with pytest.raises(CheckpointError, match=r"here: the policy is of another task .* comes from .* in training"):
            check_layout("here", info, other.spec.agents[0])
        with pytest.raises(CheckpointError, match="here: the policy is of another task"):
            check_layout("here", info, none.spec.agents[0])
        with pytest.raises(CheckpointError, match="here: the policy is of another task"):
            check_layout("here", policy_info(none, "default_policy", none.spec.agents), one.spec.agents[0])
