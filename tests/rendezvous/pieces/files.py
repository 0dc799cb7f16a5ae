"""What is said of experiments that cannot be flown, or are doubtful, on both sides of limits."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from pydantic import BaseModel

from safe_inspect.config.data import configs_root
from safe_inspect.errors import ConfigError
from safe_inspect.missions.scenario import check_scenario
from safe_inspect.missions.sensor_log import CameraDescription, StartDescription
from safe_inspect.rendezvous import models, plugins
from safe_inspect.rendezvous.control.bound import ConformalBound
from safe_inspect.rendezvous.control.design import tracking_weights
from safe_inspect.rendezvous.control.tube import TrackingLimits
from safe_inspect.rendezvous.coordination.pilot import limits_of
from safe_inspect.rendezvous.depth_camera import PROFILES, NoiseProfile, TimeOfFlightCamera
from safe_inspect.rendezvous.estimate import EstimateErrors
from safe_inspect.rendezvous.estimation.characteriser import PolhodeCharacteriser
from safe_inspect.rendezvous.estimation.graph import ISAM2BackEnd
from safe_inspect.rendezvous.experiment import RendezvousConfig, SensorsConfig, is_rendezvous, load_rendezvous
from safe_inspect.rendezvous.inertial_unit import ImuNoise
from safe_inspect.rendezvous.measured_poses import PoseSensor, StateSensor
from safe_inspect.rendezvous.planner.query import Limits
from safe_inspect.rendezvous.target.boxes import Box

from .control import Pieces

LIMITS = (Ge, Gt, Le, Lt, MaxLen, MinLen)
_FOLDER = configs_root() / "tumbling-rendezvous"
_ROOM = "chaser.limits.keep_in=[9 m, 9 m, 9 m]"
_RANDOM = "tumble={functor: RandomTumble, config: {least_rate: 2 deg/s, largest_rate: 40 deg/s}}"
#: Overrides of the experiment that is given the truth, separated by `; `.
_TRUTH = (
    "", "tumble.config.rate=20 deg/s", "tumble.config.rate=40 deg/s", "tumble.config.rate=899 deg/s",
    "tumble.config.rate=901 deg/s", "tumble.config.rate=0.08", "tumble.config.rate=0", "chaser.limits.cone=1.2",
    "chaser.velocity=[0.2 m/s, 0 m/s, 0 m/s]", "chaser.velocity=[0 m/s, 0 m/s, -0.21 m/s]", "chaser.mass=1e7 kg",
    "chaser.mass=1e7 kg; chaser.velocity=[0.001 m/s, 0 m/s, 0 m/s]", "chaser.mass=0.006 kg", "chaser.mass=0.005 kg",
    "chaser.inertia=[1.7e-4 kg m^2, 1.7e-4 kg m^2, 1.7e-4 kg m^2]",
    "chaser.inertia=[1.5e-4 kg m^2, 1.5e-4 kg m^2, 1.5e-4 kg m^2]", "chaser.inertia=[1 kg m^2, 2 kg m^2, 1 kg m^2]",
    "chaser.inertia=[1 kg m^2, 2.01 kg m^2, 1 kg m^2]", "chaser.position=[0 m, -0.4 m, 0 m]",
    "chaser.position=[0.81 m, 0 m, 0 m]", "chaser.position=[0.8 m, -1 m, 0 m]", "chaser.radius=0.35 m",
    "chaser.limits.planned_force=0.3 N", "chaser.limits.planned_force=0.29 N",
    "target.config.mating_point=[0.2 m, 0 m, 0.2 m]", "target.config.mating_point=[3.3 m, 0 m, 0 m]",
    "target.config.mating_point=[3.2 m, 0 m, 0.2 m]", "target.config.mating_point=[0 m, 0 m, 0 m]",
    f"{_RANDOM}", "mission.mean_motion=0.001 rad/s; chaser.limits.keep_in=null", "mission.update_ticks=130",
    "mission.tick=0.8 ms", "mission.tick=0.78 ms", "mission.tick=40 ms", "mission.tick=41 ms",
    "mission.tick=0.1 ms; mission.control_ticks=200; mission.update_ticks=400",
    "mission.tick=0.09 ms; mission.control_ticks=250; mission.update_ticks=500", "mission.durations=[1000 s]",
    "mission.durations=[60 s, 1000.2 s]", "mission.hold_limit=0.1 s", "mission.hold_limit=20.1 s",
    "mission.wait_limit=1000 s", "mission.wait_limit=1001 s", "mission.wait_step=0.3 s", "bound.trials=18",
    "bound.trials=19", "sensors.frame_period=0.3 s", "sensors.imu_ticks=26",
    "tumble={functor: RandomTumble, config: {least_rate: 2 deg/s, largest_rate: 2 deg/s}}",
    "tumble={functor: RandomTumble, config: {least_rate: 2.1 deg/s, largest_rate: 2 deg/s}}",
    "tumble.config.attitude=[1, 1, 1, 1]", "tumble.config.direction=[.inf, 0, 0]", "tumble.config.direction=[0, 0, 0]",
)  # fmt: skip
#: The same of the experiment with a camera.
_CAMERA = (
    "", "sensors.imu_ticks=2", "sensors.imu_ticks=3", "sensors.imu_ticks=25", "sensors.imu_ticks=26",
    "sensors.frame_period=0.3 s", "sensors.frame_period=0.4 s", "sensors.frame_period=0.05 s",
    f"{_ROOM}; chaser.position=[0 m, -3.9 m, 0 m]", f"{_ROOM}; chaser.position=[0 m, -4.1 m, 0 m]",
    f"{_ROOM}; chaser.position=[0 m, -5.1 m, 0 m]", f"{_ROOM}; chaser.position=[0 m, -5.2 m, 0 m]",
    f"{_ROOM}; chaser.position=[0 m, -5.5 m, 0 m]", "estimator.config.known_target=false", "tumble.config.rate=6 deg/s",
    "tumble.config.rate=9 deg/s", "tumble.config.rate=11 deg/s", f"{_RANDOM}",
    "estimator.config.front_end=MeasuredPoses; sensors.imu_ticks=7", "estimator.config.correlation=1.0",
    "sensors.poses.skips=0", "estimator.config.back_end.largest=9", "sensors.camera.profile=bad",
)  # fmt: skip


def _without_folders(text: str) -> str:
    return re.sub(r"[^ '`(]*/(?=[\w-]+\.(yml|py))", "", text)


def _said(file: str, overrides: str, missions: int) -> list[str]:
    try:
        experiment = load_rendezvous(_FOLDER / file, [one for one in overrides.split("; ") if one])
        said = [str(doubt) for doubt in check_scenario(experiment, missions)]
    except ConfigError as error:
        said = ["refused", *map(str, error.problems)]
    return [_without_folders(one) for one in said]


def _experiments() -> Any:
    found = {}
    for file, cases in (("experiment-truth.yml", _TRUTH), ("experiment.yml", _CAMERA)):
        found |= {f"{file} {one}": _said(file, one, 6 if one == _RANDOM else 1) for one in cases}
    return found


def _files() -> Any:
    """Return which of the shipped files are experiments of a rendezvous, and what is said of others."""
    kinds = {path.name: is_rendezvous(path) for path in sorted(_FOLDER.glob("*.yml"))}
    other = configs_root() / "translational-inspection" / "experiment.yml"
    said = []
    for path in (_FOLDER / "chaser.yml", Path(__file__), _FOLDER / "nothing.yml"):
        try:
            load_rendezvous(path)
        except ConfigError as error:
            said.append(_without_folders(str(error).partition("\n")[0]))
    return [kinds, is_rendezvous(other), is_rendezvous(_FOLDER / "nothing.yml"), said]


def _fields(model: type[BaseModel]) -> Any:
    """Return default and limits of each field."""
    return {
        name: [repr(info.default), *(repr(limit) for limit in info.metadata if isinstance(limit, LIMITS))]
        for name, info in model.model_fields.items()
    }


def _options() -> Any:
    kinds = [getattr(plugins, name) for name in sorted(vars(plugins)) if name[0].isupper()]
    shared = [
        models.ActuatorConfig, models.LimitsConfig, models.ChaserConfig, models.Fault, models.MissionConfig,
        SensorsConfig, RendezvousConfig, PoseSensor, StateSensor, TimeOfFlightCamera, ConformalBound,
        ISAM2BackEnd, PolhodeCharacteriser, Box, CameraDescription, StartDescription,
    ]  # fmt: skip
    return {model.__name__: _fields(model) for model in (*kinds, *shared)} | {
        "dataclasses": [
            repr(one) for one in (
                ImuNoise(), NoiseProfile(1.0, 2.0), *PROFILES.values(), TrackingLimits(),
                EstimateErrors(0.1, 0.2),
            )
        ],
        "weights": [tracking_weights(), tracking_weights(0.6)],
        "limits": [*vars(Limits()).values()],
        "longer": [*vars(limits_of(models.ChaserConfig(radius=0.3), 2.0)).values()],
    }  # fmt: skip


PIECES: Pieces = {"experiments": _experiments, "files": _files, "options": _options}
