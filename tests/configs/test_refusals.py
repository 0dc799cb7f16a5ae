"""Overrides that do not fit are refused with the whole text of each message, and those at the limits are accepted."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import Experiment, load_experiment
from safe_inspect.errors import ConfigError

#: Abbreviations of long paths in ``refusals.yml``, as overrides write the paths and as messages do.
PATHS = {
    "AGENT": ("agent_config.0.config.config", "agent_config[0].config.config"),
    "ENVIRONMENT": ("config.config.env_config", "config.config.env_config"),
    "RESET": (
        "config.config.env_config.simulator_reset_parameters",
        "config.config.env_config.simulator_reset_parameters",
    ),
}
TABLE = yaml.safe_load((Path(__file__).parent / "refusals.yml").read_text(encoding="utf-8"))
CASES = [
    pytest.param(file, entry["overrides"], entry["shown"], id=name)
    for file, entries in TABLE.items()
    for name, entry in entries.items()
]
ONE, TEAM, DOCKING = (
    "translational-inspection/experiment.yml",
    "multiagent-translational-inspection/experiment.yml",
    "docking/experiment.yml",
)
FILTERED = "RTAGlueCWHInspection1v1.config.enabled=True"


def _written_out(text: str, form: int) -> str:
    start = "~" if text.startswith("~") else ""
    head = text.removeprefix(start).partition("=")[0].partition(":")[0].partition(".")[0].partition("[")[0]
    return start + PATHS.get(head, (head, head))[form] + text.removeprefix(start).removeprefix(head)


def _loaded(file: str, overrides: list[str]) -> Experiment:
    return load_experiment(configs_root() / file, [_written_out(override, 0) for override in overrides])


@pytest.mark.parametrize(("file", "overrides", "shown"), CASES)
def test_what_does_not_fit_is_refused(file: str, overrides: list[str], shown: list[str]) -> None:
    with pytest.raises(ConfigError) as caught:
        _loaded(file, overrides)
    texts = [f"{one.path}: {one.message}" + (f"; {one.hint}" if one.hint else "") for one in caught.value.problems]
    assert texts == [_written_out(text, 1) for text in shown]
    places = [one.location for one in caught.value.problems]
    given = [_written_out(override, 0) for override in overrides]
    assert all(place is None or place.line > 0 or place.text in given for place in places)


@pytest.mark.parametrize(
    ("file", "overrides"),
    [
        (ONE, ["~ENVIRONMENT.horizon", "config.config.rllib_configs.local.horizon=2147483647"]),
        (ONE, ["~ENVIRONMENT.horizon", "config.config.rllib_configs.local.horizon=1"]),
        (ONE, ["ENVIRONMENT.horizon=2147483647"]),
        (ONE, ["ENVIRONMENT.horizon=100", "AGENT.dones.2={functor: EpisodeLengthDone, config: {horizon: 100}}"]),
        (ONE, [FILTERED, "RTAGlueCWHInspection1v1.config.u_max=1 N", "RTAGlueCWHInspection1v1.config.m=12 kg"]),
        (ONE, [FILTERED, "RTAGlueCWHInspection1v1.config.n=0.001027", "AGENT.parts.2.config.properties.high=1 N"]),
        (ONE, ["RTAGlueCWHInspection1v1.config.u_max=2 N"]),
        (ONE, ["RESET.init_state.config.rta.args.collision_radius=10 m"]),
        (ONE, ["AGENT.glues.0.wrapped=[{functor: DiscreteControllerGlue, config: {controller: X Thrust, levels: "
               "[0, 1 N]}}, {functor: CoastGlue, config: {durations: [1, 2]}}]"]),
        (ONE, ["RESET.additional_entities.moon={platform: cwh, "
               "config: {x: 9, y: 9, z: 9, x_dot: 0, y_dot: 0, z_dot: 0}}"]),
        (ONE, ["RESET.spare=1", "RESET.additional_entities.sun.config.theta={type: SimAttributeAccessor, "
               "config: {attribute_name: spare}}"]),
        (ONE, ["blue0_ctrl.policy_name=common"]),
        (ONE, ["agent_config.0.policy=null"]),
        (TEAM, ["ENVIRONMENT.rta.config.m=12 kg", "ENVIRONMENT.rta.config.step_size=10 s"]),
        (TEAM, ["ENVIRONMENT.rta.config.enabled=False", "ENVIRONMENT.ended_deputies=hold_thrust"]),
        ("multiagent-translational-inspection/experiment-mixed.yml", ["agent_config.0.count=98"]),
        (DOCKING, ["RTAGlueCWHDocking3d.config.enabled=True"]),
        (DOCKING, ["AGENT.dones.2.config.velocity_constraint.velocity_threshold=0.1"]),
    ],
)  # fmt: skip
def test_what_fits_just_so_is_accepted(file: str, overrides: list[str]) -> None:
    assert _loaded(file, overrides).spec.agents
