"""What would void the guarantee of a safety filter is refused when the experiment is loaded."""

from __future__ import annotations

import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.errors import ConfigError

_ON = "RTAGlueCWHInspection1v1.config.enabled=True"
_AGENT = "agent_config.0.config.config"
_SIMULATOR = "config.config.env_config.simulator.config"
_RESET = "config.config.env_config.simulator_reset_parameters"
_CHIEF = f"{_RESET}.additional_entities.chief.config"
_SLOW_SUN = f"{_SIMULATOR}.illumination_params.mean_motion=0.0005"
_CRASH = f"{_AGENT}.dones.1={{functor: CrashDoneFunction, config: {{crash_region_radius: 15}}}}"
_NEAR = f"{_AGENT}.dones.0={{functor: MaxDistanceDoneFunction, config: {{max_distance: 400}}}}"
_PAIR = (
    f"{_AGENT}.glues.0.wrapped=[{{functor: RTAGlueCWHInspection1v1, config: {{enabled: True, constraints: [sun]}}, "
    "wrapped: [{functor: ControllerGlue, config: {controller: X Thrust}}]}]"
)
_DISTURBANCE = "{functor: BoundedDisturbance, config: {velocity: 1.0e-4}}"
_PLANE = f"{_AGENT}.parts.2.config.axis=1"  # two controllers along y and none along z


def _load(folder: str, *overrides: str) -> None:
    load_experiment(configs_root() / folder / "experiment.yml", overrides).spec  # noqa: B018


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (
            (f"{_SIMULATOR}.illumination_params.mean_motion=0.0005",),
            "a sun that turns once an orbit, at 0.001027 rad/s",
        ),
        ((f"{_CHIEF}.x=50",), "'chief' does not rest there"),
        ((f"{_CHIEF}.y_dot=0.001",), "'chief' does not rest there"),
        ((f"{_CHIEF}.z={{type: UniformParameter, config: {{low: 0, high: 1}}}}",), "'chief' does not rest there"),
        ((_CRASH,), "crashes within 15 m of the chief"),
        ((_NEAR,), "lost beyond 400 m, and the filter lets it fly to 800 m"),
        ((_PAIR,), "glues[0].wrapped[0].config.enabled: another safety filter of this agent is enabled"),
        ((_PLANE,), "blue0_ctrl has no controller along z"),
    ],
)
def test_what_voids_the_guarantee_is_refused(overrides: tuple[str, ...], words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        _load("translational-inspection", _ON, *overrides)
    assert words in str(caught.value)
    if overrides != (_PAIR,):
        _load("translational-inspection", *overrides)  # without a filter it is a task like others


def test_a_mistake_in_what_is_checked_is_one_message() -> None:
    with pytest.raises(ConfigError) as caught:
        _load("translational-inspection", _ON, f"{_CHIEF}={{x: 0}}")
    assert "`y`" in str(caught.value)
    assert "does not rest" not in str(caught.value)


def test_constraints_that_are_left_out_ask_nothing() -> None:
    _load("translational-inspection", _ON, f"{_AGENT}.reference_store.constraints=[rel_vel, PSM]", _SLOW_SUN, _NEAR)


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("config.config.env_config.dones.shared.0.config.safety_constraint=12 m", "the filter keeps them 10 m apart"),
        ("agent_config.0.config.config.parts.2.config.axis=1", "blue0_ctrl has no controller along z"),
        (f"{_CHIEF}.x=50", "'chief' does not rest there"),
        (
            f"{_SIMULATOR}.disturbance={_DISTURBANCE}",
            "the simulation is disturbed, and this filter promises nothing then",
        ),
    ],
)
def test_the_filter_of_a_team_is_checked_too(override: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        _load("multiagent-translational-inspection", override)
    assert words in str(caught.value)
