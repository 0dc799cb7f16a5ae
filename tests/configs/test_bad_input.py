"""Every mistake in a configuration gives one message: file and line, path of keys, what is wrong, what to do."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

from safe_inspect.config.experiment import load_experiment
from safe_inspect.config.loading.loader import parse
from safe_inspect.errors import ConfigError, Location
from safe_inspect.plugins.registry import registry

FOLDER = "configs/translational-inspection"
AGENT = "agent_config[0].config.config"
ENVIRONMENT = "config.config.env_config"
RESET = f"{ENVIRONMENT}.simulator_reset_parameters"
POINTS = f"{ENVIRONMENT}.simulator.config.inspection_points_map"


PATHS = {"AGENT": AGENT, "ENVIRONMENT": ENVIRONMENT, "RESET": RESET, "POINTS": POINTS}


@dataclass(frozen=True)
class Mistake:
    """One entry of ``mistakes.yml``."""

    name: str
    file: str
    right: str
    wrong: str
    words: list[str]
    path: str = ""
    at: str = ""
    elsewhere: bool = False

    @property
    def experiment(self) -> str:
        """The experiment that shows the mistake."""
        return f"{FOLDER}/{'experiment-seed.yml' if self.file.endswith('-seed.yml') else 'experiment.yml'}"

    @property
    def full_path(self) -> str:
        head = self.path.partition(".")[0].partition("[")[0]
        return PATHS.get(head, head) + self.path.removeprefix(head)

    def spoil(self, folder: Path) -> int:
        """Write the mistake and return the number of the line that the message is to point at."""
        path = folder / self.file
        text = path.read_text()
        assert self.right in text
        text = text.replace(self.right, self.wrong, 1)
        path.write_text(text)
        return text[: text.index(self.at or self.wrong)].count("\n") + 1


MISTAKES = [Mistake(**entry) for entry in yaml.safe_load((Path(__file__).parent / "mistakes.yml").read_text())]


@pytest.mark.parametrize("mistake", [m for m in MISTAKES if not m.elsewhere], ids=lambda mistake: mistake.name)
def test_one_mistake_gives_one_message(copied, mistake):
    line = mistake.spoil(copied)
    with pytest.raises(ConfigError) as caught:
        load_experiment(mistake.experiment)
    (problem,) = caught.value.problems
    text = str(caught.value)
    assert text.startswith(f"{FOLDER}/{mistake.file}:{line} {mistake.full_path}: ")
    for words in mistake.words:
        assert words in text
    assert problem.path == mistake.full_path
    assert "\n" not in text


@pytest.mark.parametrize("mistake", [m for m in MISTAKES if m.elsewhere], ids=lambda mistake: mistake.name)
def test_a_mistake_that_shows_elsewhere(copied, mistake):
    mistake.spoil(copied)
    with pytest.raises(ConfigError) as caught:
        load_experiment(mistake.experiment)
    assert caught.value.problems
    for problem in caught.value.problems:
        assert problem.location is not None
        assert problem.location.line > 0
    for words in mistake.words:
        assert words in str(caught.value)


def test_all_mistakes_of_a_kind_are_reported_together(copied):
    names = ["a key of a reward", "a part", "a unit", "a negative radius", "a text for a number", "a done",
             "a reference to nothing", "a key of the task"]  # fmt: skip
    chosen = [mistake for mistake in MISTAKES if mistake.name in names]
    assert len(chosen) == len(names)
    places = {f"{FOLDER}/{mistake.file}:{mistake.spoil(copied)} {mistake.full_path}" for mistake in chosen}
    with pytest.raises(ConfigError) as caught:
        load_experiment("configs/translational-inspection/experiment.yml")
    assert {f"{problem.location} {problem.path}" for problem in caught.value.problems} == places


def test_all_wrong_names_are_reported_together(copied):
    names = ["a sensor in a glue", "a controller in a glue", "an entity in a sensor", "two rewards of one name",
             "an accessor to no state", "an unused reset parameter", "a horizon among the dones"]  # fmt: skip
    chosen = [mistake for mistake in MISTAKES if mistake.name in names]
    assert len(chosen) == len(names)
    places = {f"{FOLDER}/{mistake.file} {mistake.full_path}" for mistake in chosen if mistake.spoil(copied)}
    with pytest.raises(ConfigError) as caught:
        load_experiment("configs/translational-inspection/experiment.yml")
    assert {f"{problem.location.file} {problem.path}" for problem in caught.value.problems} == places


def test_a_missing_include(copied):
    experiment = copied / "experiment.yml"
    experiment.write_text(experiment.read_text().replace("./agent.yml", "./agnet.yml"))
    with pytest.raises(ConfigError, match=r"experiment\.yml:\d+.*agnet\.yml.*did you mean `\./agent\.yml`"):
        load_experiment(experiment)


def test_a_circle_of_includes(copied):
    (copied / "parameters.yml").write_text("collision_radius: !include ./agent.yml\n")
    with pytest.raises(ConfigError) as caught:
        load_experiment("configs/translational-inspection/experiment.yml")
    text = str(caught.value)
    assert "circular `!include`" in text
    assert "agent.yml -> " in text
    assert text.startswith(f"{FOLDER}/agent.yml:")
    assert "remove one `!include`" in text


def test_no_experiment_at_all(copied):
    with pytest.raises(ConfigError, match=r"no file 'configs/nothing\.yml'"):
        load_experiment("configs/nothing.yml")
    with pytest.raises(ConfigError, match=r"not an experiment.*give the experiment file, not 'agent\.yml'"):
        load_experiment(copied / "agent.yml")
    with pytest.raises(ConfigError, match=r"did you mean `configs/translational-inspection/experiment\.yml`"):
        load_experiment("configs/translational-inspection/experimnt.yml")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "empty"),
        ("- 1\n- 2\n", "not an experiment"),
        ("config: [1, 2\n", "experiment.yml:"),
        ("config: 5\nplatform_config: []\nagent_config: []\n", "config"),
        ("config: !include ./task.yml\nplatform_config: []\nagent_config: []\n", "platform_config: the list is empty"),
        ("config: {}\nplatform_config: 3\nagent_config: nothing\n", "agent_config"),
    ],
)
def test_files_that_are_hardly_experiments(copied, text, words):
    (copied / "experiment.yml").write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_experiment("configs/translational-inspection/experiment.yml")
    assert words in str(caught.value)


def test_a_mistake_of_the_command_line_names_it(copied):
    with pytest.raises(ConfigError) as caught:
        load_experiment(copied / "experiment.yml", ["chief.radius=-3", "ObservedPointsReward.config.scael=1"])
    text = str(caught.value)
    assert text.startswith("command line: ")
    assert "ObservedPointsReward.config.scael=1" in text


@pytest.mark.parametrize("key", ["functor", "plugin_paths"])
@pytest.mark.parametrize("text", ["import no_such_dependency\n", "1 / 0\n", "class (:\n"])
def test_a_module_that_fails_is_named_with_its_line(copied, tmp_path, monkeypatch, key, text):
    (tmp_path / "failing_module.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    value = "failing_module.Mine" if key == "functor" else "[failing_module]"
    place = "ObservedPointsReward.functor" if key == "functor" else "config.config.env_config.plugin_paths"
    with pytest.raises(ConfigError, match=r"cannot be imported: .*failing_module\.py:1: ") as caught:
        load_experiment(copied / "experiment.yml", [f"{place}={value}"])
    assert f"{place}={value}" in str(caught.value)


@pytest.mark.parametrize("status", ["", "    status = DoneStatus.RUNNING"])
def test_a_done_function_without_a_status(copied, tmp_path, monkeypatch, status):
    lines = ["from safe_inspect.dones import DoneFunction, DoneStatus", "class StatuslessDone(DoneFunction):", status]
    (tmp_path / "statusless.py").write_text("\n".join([*lines, "    def __call__(self, step): return step.dt < 0"]))
    monkeypatch.delitem(sys.modules, "statusless", raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(registry._classes, "done", dict(registry.items("done")))
    with pytest.raises(
        ConfigError, match=r"StatuslessDone has no `status` of an end; define one in its class"
    ) as caught:
        load_experiment(copied / "experiment.yml", ["dones.1={functor: statusless.StatuslessDone}"])
    assert "dones[1]" in str(caught.value)


PARTS = """
from typing import ClassVar

from safe_inspect.glues import ObservationGlue
from safe_inspect.platforms import Sensor

class {name}Sensor(Sensor):
    elements = {elements}
    bounds = {bounds}

    def __call__(self, view): return view.position[:, :1]

class {name}Glue(ObservationGlue):
    names: ClassVar[tuple[str, ...]] = ("x",)

    def bounds(self, parts): return [0.0], [1.0]
    def __call__(self, view): return view.position[:, :1]
"""


@pytest.mark.parametrize(
    ("name", "elements", "bounds", "added", "message"),
    [
        (
            "Turned",
            ("x",),
            (180.0, 0.0),
            "parts+",
            "the bounds of TurnedSensor are reversed: 180 is above 0",
        ),
        ("Text", "angle", (0.0, 1.0), "parts+", r"the elements of TextSensor are .* write the tuple \('angle',\)"),
        ("Fixed", ("x",), (0.0, 1.0), "glues+", "`names` of FixedGlue is not a method; define it with `def`"),
    ],
)
def test_attributes_of_a_plugin_that_do_not_fit(copied, tmp_path, monkeypatch, name, elements, bounds, added, message):
    text = PARTS.format(name=name, elements=repr(elements), bounds=bounds)
    (tmp_path / f"attributes_{name}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    item = f"part: attributes_{name}.{name}Sensor" if added == "parts+" else f"functor: attributes_{name}.{name}Glue"
    with pytest.raises(ConfigError, match=message):
        load_experiment(copied / "experiment.yml", [f"blue0_ctrl.{added}=[{{{item}}}]"])


def test_overrides_that_are_one_text(copied):
    with pytest.raises(ConfigError, match=r"overrides must be a list of strings; write \['horizon=30'\]"):
        load_experiment(copied / "experiment.yml", "horizon=30")


def test_an_id_that_is_misspelt():
    with pytest.raises(ConfigError, match=r"did you mean `safe_inspect/TranslationalInspection-v1`\?"):
        load_experiment("safe_inspect/TranslationalInspektion-v0")


@pytest.mark.parametrize(("text", "value"), [("1:30", "90"), ("0600", "384"), ("-1:30.5", "-90.5"), ("-0_17", "-15")])
def test_a_number_that_yaml_reads_in_another_base_is_refused(copied, text, value):
    environment = copied / "environment.yml"
    environment.write_text(f"horizon: {text}\n" + environment.read_text().replace("horizon:", "# horizon:"))
    for overrides in ([], [f"horizon={text}"], [f"lr={text}"]):
        with pytest.raises(ConfigError, match=f"YAML reads `{text}` as {value}; write {value} if that is intended"):
            load_experiment(copied / "experiment.yml", overrides)


@pytest.mark.parametrize("text", ["0", "00", "0.6", "007.5", "0x10", "1_000", "'1:30'"])
def test_other_numbers_and_quoted_texts_are_read(text):
    assert parse(f"{{a: {text}}}", Location("command line", 0)) == yaml.safe_load(f"{{a: {text}}}")


@pytest.mark.parametrize(
    ("override", "want"),
    [
        ("horizon=yes", "a whole number"),
        ("ObservedPointsReward.config.scale=on", "a number"),
        ("config.config.env_config.simulator.config.decimation=true", "a whole number"),
        ("blue0_ctrl.policy={functor: SixDofInspector, config: {initial_sensor_unit_vec: [on, 0, 0]}}", "a number"),
    ],
)
def test_a_truth_value_is_no_number(override, want):
    with pytest.raises(ConfigError, match=f"expected {want}, got"):
        load_experiment("configs/translational-inspection/experiment.yml", [override])


def test_an_initialiser_that_agents_replace_is_known_all_the_same():
    place = "config.config.env_config.simulator_reset_parameters.initializer"
    with pytest.raises(ConfigError, match="unknown initializer 'x'; known"):
        load_experiment("configs/translational-inspection/experiment.yml", [f"{place}={{functor: x}}"])
