"""What would void the guarantee of a safety filter is refused when the experiment is loaded."""

from __future__ import annotations

from typing import ClassVar

import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.dynamics import Dynamics
from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.dynamics.clohessy_wiltshire import clohessy_wiltshire_row
from safe_inspect.dynamics.cwh import transition
from safe_inspect.errors import ConfigError, SafetyFilterWarning
from safe_inspect.simulators import Component, RunningComponent

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
_NESTED = (
    f"{_AGENT}.glues.0.wrapped=[{{functor: RTAGlueCWHInspection1v1, config: {{enabled: True}}, "
    "wrapped: [{functor: ControllerGlue, config: {controller: X Thrust}}]}]"
)
_BEACON = (
    f"{_RESET}.additional_entities.beacon={{platform: cwh, initializer: {{functor: PositionVelocityInitializer}}, "
    "config: {x: 0, y: 30, z: 0, x_dot: 0, y_dot: 0, z_dot: 0}}"
)
_THETA = f"{_RESET}.additional_entities.sun.config.theta"
_TEAM = "multiagent-translational-inspection"
_UNEQUAL = (
    "platform_config=[{name: blue0, config: {platform: cwh, config: {mass: 12}}}, {name: blue1, config: "
    "{platform: cwh, config: {mass: 20}}}, {name: blue2, config: {platform: cwh, config: {mass: 12}}}]"
)
_NO_MASS = f"{_AGENT}.rewards.3={{functor: InspectionDeltaVReward, config: {{mode: scale}}}}"
_DOCKING = "RTAGlueCWHDocking3d.config.enabled=True"
_TIGHT = f"{_AGENT}.dones.2.config.velocity_constraint"
_ABOUT_ITSELF = (
    f"{_AGENT}.dones.0={{functor: MaxDistanceDoneFunction, config: {{max_distance: 800, "
    "reference_position_sensor_name: Sensor_Position}}"
)
_PLANE = f"{_AGENT}.parts.2.config.axis=1"  # two controllers along y and none along z


def _load(folder: str, *overrides: str, file: str = "experiment.yml") -> None:
    load_experiment(configs_root() / folder / file, overrides).spec  # noqa: B018


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (
            (f"{_SIMULATOR}.illumination_params.mean_motion=0.0005",),
            "a sun with one rotation per orbit, 0.001027 rad/s",
        ),
        ((f"{_CHIEF}.x=50",), "at the origin, and 'chief' is not"),
        ((f"{_CHIEF}.y_dot=0.001",), "at the origin, and 'chief' is not"),
        ((f"{_CHIEF}.z={{type: UniformParameter, config: {{low: 0, high: 1}}}}",), "at the origin, and 'chief' is not"),
        ((_CRASH,), "crashes within 15 m of the chief"),
        ((_NEAR,), "loses beyond 400 m, but the filter allows up to 800 m"),
        ((_PAIR,), "glues[0].wrapped[0].config.enabled: another safety filter of this agent is enabled"),
        ((_PLANE,), "blue0_ctrl has no controller along z"),
        (
            (f"{_SIMULATOR}.illumination_params.mean_motion=0.00102700001",),
            "0.001027 rad/s, but this one has 0.00102700001 rad/s",
        ),
        ((f"{_THETA}=1.0",), "sun.config.theta: `init_state` tests initial states with a sun angle that it samples"),
        (
            (f"{_THETA}={{type: UniformParameter, config: {{units: rad, low: 0, high: 6}}}}",),
            "sun.config.theta: `init_st",
        ),
        (
            (_BEACON, f"{_AGENT}.parts.8.config.entity_name=beacon"),
            "dones[0].config.reference_position_sensor_name: the filter assumes a chief at rest at the origin, but "
            "'reference_position' does not read such a body",
        ),
        (
            (_ABOUT_ITSELF,),
            "dones[0].config.reference_position_sensor_name: the filter assumes a chief at rest at the origin, but "
            "'Sensor_Position' does not read such a body",
        ),
        ((f"{_AGENT}.reference_store.constraints=[]",), "`constraints` is empty, so the filter enforces nothing"),
    ],
)
def test_what_voids_the_guarantee_is_refused(overrides: tuple[str, ...], words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        _load("translational-inspection", _ON, *overrides)
    assert words in str(caught.value)
    if overrides != (_PAIR,):
        _load("translational-inspection", *overrides)  # without a filter it is a task like others


def test_a_filter_that_never_acts_is_refused() -> None:
    with pytest.raises(ConfigError) as caught:
        _load("translational-inspection", _NESTED)
    words = "glues[0].wrapped[0].config.enabled: this safety filter has no effect, because a glue"
    assert words in str(caught.value)


def test_done_functions_about_other_bodies_are_no_concern_of_other_constraints() -> None:
    speeds = f"{_AGENT}.reference_store.constraints=[x_vel, y_vel, z_vel]"
    _load("translational-inspection", _ON, _BEACON, f"{_AGENT}.parts.8.config.entity_name=beacon", speeds)


@pytest.mark.parametrize(
    ("field", "words"),
    [
        ("velocity_threshold=0.1", "reaches 0.5 m faster than 0.1 m/s, but the filter allows 0.2 m/s there"),
        ("threshold_distance=0.5 m", ""),
        ("velocity_threshold=0.3", ""),
        ("lower_bound=True", ""),
    ],
)
def test_a_crash_below_the_speed_limit_of_docking_is_refused(field: str, words: str) -> None:
    _load("docking", f"{_TIGHT}.{field}")
    if not words:
        _load("docking", _DOCKING, f"{_TIGHT}.{field}")
        return
    with pytest.raises(ConfigError) as caught:
        _load("docking", _DOCKING, f"{_TIGHT}.{field}")
    assert f"dones[2].config.velocity_constraint: a deputy crashes if it {words}" in str(caught.value)


def test_a_teams_filter_that_is_switched_off_blocks_nobody() -> None:
    off = "rta.config.enabled=False"
    _load(_TEAM, off, _UNEQUAL, _NO_MASS, _ON)
    _load(_TEAM, off, "rta.config.constraints=[]")
    with pytest.raises(ConfigError, match=r"rta\.config\.m: `m` is 12 here, but the platform's `mass` is 20"):
        _load(_TEAM, _UNEQUAL, _NO_MASS)
    with pytest.raises(ConfigError, match="`constraints` is empty, so the filter enforces nothing"):
        _load(_TEAM, "rta.config.constraints=[]")


class SilentComponent(Component):
    """A component that does not say what it does to the motion."""

    def __call__(self, world, num_envs):
        """Return a component that does nothing."""
        return RunningComponent()


class Wind(Component):
    """A component that adds a velocity in every step.

    Attributes:
        acceleration: What it amounts to [m/s^2].
    """

    acceleration: float = 1e-5

    def __call__(self, world, num_envs):
        """Return a component that does nothing, for a test that flies nothing."""
        return RunningComponent()

    def disturbance_bounds(self, limits):
        """Return the velocity of a step."""
        return DisturbanceBounds(velocity=self.acceleration * limits.step_size)


class Elliptic(Dynamics):
    """Motion with a mean motion that is not said to be that of Clohessy and Wiltshire.

    Attributes:
        share: Departure from it, as a share of the range in a step [1/s]; negative: it is not declared.
    """

    row: ClassVar = clohessy_wiltshire_row

    share: float = -1.0

    def __call__(self, step_size):
        """Return the maps of a body of 1 kg."""
        return transition(0.001027, 1.0, step_size)

    def offers(self):
        """Return the mean motion."""
        return {"mean_motion": 0.001027}

    def disturbance_bounds(self, limits):
        """Return what the departure amounts to at the largest range."""
        return None if self.share < 0.0 else DisturbanceBounds(velocity=self.share * limits.distance)


_HERE = __name__
_BOUNDS = "RTAGlueCWHInspection1v1.config.disturbance"
_SILENT = f"{_SIMULATOR}.disturbance={{functor: {_HERE}.SilentComponent}}"
_WIND = f"{_SIMULATOR}.disturbance={{functor: {_HERE}.Wind}}"
_ELLIPTIC = f"{_SIMULATOR}.dynamics={{functor: {_HERE}.Elliptic}}"
_DECLARED = f"{_SIMULATOR}.dynamics={{functor: {_HERE}.Elliptic, config: {{share: 1.0e-7}}}}"
_COMPOSED = (
    "config.config.env_config.simulator={type: ComposedSimulator, config: {components: "
    f"[{{functor: {_HERE}.NAME}}]}}}}"
)


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ((_SILENT,), "SilentComponent may change the motion that the filter assumes, but has no"),
        ((_SILENT, f"{_BOUNDS}={{velocity: 1.0e-3}}"), "SilentComponent may change the motion"),
        ((_DECLARED, f"{_AGENT}.reference_store.constraints=[rel_vel]"), "Elliptic may change the motion"),
        ((_ELLIPTIC,), "Elliptic may change the motion that the filter assumes, but has no"),
        ((_WIND,), "disturbed by Wind, and this filter gives no guarantee then; give the filter `disturbance: {"),
        (
            (_WIND, f"{_BOUNDS}={{velocity: 9.0e-5}}"),
            "`velocity` is 0.0001, from Wind, which exceeds this bound",
        ),
        (
            (_DECLARED, f"{_BOUNDS}={{velocity: 7.0e-5}}"),
            "`velocity` is 8e-05, from Elliptic, which exceeds this bound",
        ),
        (
            (_DECLARED, _WIND, f"{_BOUNDS}={{velocity: 1.5e-4}}"),
            "`velocity` is 0.00018, from Wind and Elliptic, which exceeds this bound",
        ),
    ],
)
def test_what_components_and_dynamics_do_to_the_motion_is_counted(overrides: tuple[str, ...], words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        _load("translational-inspection", _ON, *overrides)
    assert words in str(caught.value)
    off = [override for override in overrides if _BOUNDS not in override]
    _load("translational-inspection", *off)
    _load("translational-inspection", _ON, *off, "RTAGlueCWHInspection1v1.config.method=continuous")


def test_declared_bounds_within_those_of_the_filter_are_accepted() -> None:
    _load("translational-inspection", _ON, _WIND, f"{_BOUNDS}={{velocity: 1.0e-4}}")
    _load("translational-inspection", _ON, _DECLARED, _WIND, f"{_BOUNDS}={{velocity: 1.9e-4}}")


@pytest.mark.parametrize(("override", "name"), [(_SILENT, "SilentComponent"), (_ELLIPTIC, "Elliptic")])
def test_what_declares_nothing_is_flown_with_a_warning_where_that_is_asked_for(override: str, name: str) -> None:
    with pytest.warns(
        SafetyFilterWarning, match=f"{name} may change the motion.*the filter gives no guarantee"
    ) as caught:
        _load("translational-inspection", _ON, override, "RTAGlueCWHInspection1v1.config.undeclared=warn")
    assert len(caught) == 1


def test_components_of_a_composed_simulator_are_counted_for_a_team_too() -> None:
    composed = _COMPOSED.replace("NAME", "SilentComponent")
    with pytest.raises(ConfigError, match=r"env_config\.rta\.config\.enabled: SilentComponent may change the motion"):
        _load(_TEAM, f"{_SIMULATOR}.disturbance={{functor: {_HERE}.SilentComponent}}")
    with pytest.raises(ConfigError, match="SilentComponent may change the motion"):
        _load("docking", _DOCKING, composed)
    _load("docking", _DOCKING, "config.config.env_config.simulator={type: ComposedSimulator}")


def test_the_sun_must_be_one_that_is_known() -> None:
    controllers = ", ".join(f"{{functor: ControllerGlue, config: {{controller: {axis} Thrust}}}}" for axis in "XYZ")
    glue = f"{{functor: RTAGlueCWHInspection1v1, config: {{enabled: True}}, wrapped: [{controllers}]}}"
    simulator = "config.config.env_config.simulator={type: ComposedSimulator}"
    with pytest.raises(ConfigError, match="the constraint `sun` needs the component `Sun`"):
        _load("docking", f"{_AGENT}.glues.0={glue}", simulator)


def _thrusters(largest: float) -> list[str]:
    return [
        f"{_AGENT}.parts.{axis}.config.properties={{name: {name}_thrust, low: -{largest}, high: {largest}}}"
        for axis, name in enumerate("xyz")
    ]


def test_thrusters_that_cannot_brake_against_the_tide_are_flown_with_a_note() -> None:
    with pytest.warns(SafetyFilterWarning) as caught:
        _load("translational-inspection", _ON, *_thrusters(0.05), file="experiment-seed.yml")
    (note,) = [str(item.message) for item in caught]
    words = "blue0_ctrl: thrusters of 0.05 N cannot brake 12 kg against the tide everywhere; of 3530 safe states"
    assert note.startswith(words)
    assert 50.0 < float(note.rpartition("can keep safe ")[2].removesuffix(" %")) < 58.0


def test_thrusters_that_keep_nothing_are_refused() -> None:
    limits = [f"{_AGENT}.reference_store.constraints=[x_vel, {{functor: z_vel, config: {{vel_limit: 1.0e-5}}}}]"]
    with pytest.raises(
        ConfigError, match=r"glues: blue0_ctrl: .* the filter cannot keep any of \d+ sampled safe states"
    ):
        _load("translational-inspection", _ON, *_thrusters(0.001), *limits, file="experiment-seed.yml")


def test_the_method_continuous_needs_thrusters_that_brake() -> None:
    continuous = "RTAGlueCWHInspection1v1.config.method=continuous"
    with pytest.raises(ConfigError, match=r"cannot brake against the tide at .*as the method 'continuous' needs"):
        _load("translational-inspection", _ON, continuous, *_thrusters(0.02), file="experiment-seed.yml")


def test_a_mistake_in_what_is_checked_is_one_message() -> None:
    with pytest.raises(ConfigError) as caught:
        _load("translational-inspection", _ON, f"{_CHIEF}={{x: 0}}")
    assert "`y`" in str(caught.value)
    assert "a chief at rest" not in str(caught.value)


def test_constraints_that_are_left_out_ask_nothing() -> None:
    _load("translational-inspection", _ON, f"{_AGENT}.reference_store.constraints=[rel_vel, PSM]", _SLOW_SUN, _NEAR)


@pytest.mark.parametrize(
    ("override", "words"),
    [
        (
            "config.config.env_config.dones.shared.0.config.safety_constraint=12 m",
            "the filter only keeps them 10 m apart",
        ),
        ("agent_config.0.config.config.parts.2.config.axis=1", "blue0_ctrl has no controller along z"),
        (f"{_CHIEF}.x=50", "at the origin, and 'chief' is not"),
        (
            f"{_SIMULATOR}.disturbance={_DISTURBANCE}",
            "the simulation is disturbed by BoundedDisturbance, and this filter gives no guarantee then",
        ),
    ],
)
def test_the_filter_of_a_team_is_checked_too(override: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        _load("multiagent-translational-inspection", override)
    assert words in str(caught.value)
