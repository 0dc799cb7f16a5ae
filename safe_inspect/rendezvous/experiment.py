"""`load_rendezvous`: load an experiment file with overrides, check it, and report all mistakes at once."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_args

from pydantic import BaseModel, Field, field_validator, model_validator

from safe_inspect.config.fields import written_values
from safe_inspect.config.loading.loader import import_plugins, load, places
from safe_inspect.config.loading.located import LocatedDict, LocatedList, ResolvedExperiment, locate, with_value
from safe_inspect.config.loading.merge import merge
from safe_inspect.config.models import ExperimentConfig, Model
from safe_inspect.config.overrides import apply_overrides
from safe_inspect.config.report import validated
from safe_inspect.errors import ConfigError, Location, Problem
from safe_inspect.plugins.functor import functor_field, misplaced
from safe_inspect.rendezvous.control.bound import ConformalBound
from safe_inspect.rendezvous.depth_camera import TimeOfFlightCamera
from safe_inspect.rendezvous.inertial_unit import ImuNoise, checked_noise
from safe_inspect.rendezvous.measured_poses import MarkSensor, PoseSensor, StateSensor
from safe_inspect.rendezvous.models import ChaserConfig, MissionConfig
from safe_inspect.rendezvous.plugins import MeshTarget
from safe_inspect.rendezvous.readings import Reading
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.units import PositiveDuration

#: Keys whose value may be a list of mappings, which are then merged from left to right.
_MERGED = ("mission", "chaser")
_MESHES = (".stl", ".ply", ".obj")


def _plugin(kind: str, default: str | dict[str, Any]) -> Any:
    return Annotated[functor_field(kind), Field(default=default, validate_default=True)]


class SensorsConfig(Model):
    """The sensors of the chaser. A sensor that the estimator does not read is not simulated.

    Attributes:
        camera: The depth camera.
        frame_period: Time between two frames [s], a multiple of the control step.
        imu: Errors of the inertial unit.
        imu_ticks: Number of ticks between two samples of the inertial unit.
        poses: Simulated sensor of relative poses, which ``MeasuredPoses`` reads instead of frames.
        state: Simulated sensor of states, which ``MeasuredState`` reads.
        mark: Simulated operator who marks the mating point in frames, which ``MappingEstimator`` reads.
    """

    camera: TimeOfFlightCamera = TimeOfFlightCamera()
    frame_period: PositiveDuration = 1.0  # type: ignore[valid-type]
    imu: ImuNoise = ImuNoise()
    imu_ticks: int = Field(default=2, ge=1)
    poses: PoseSensor = PoseSensor()
    state: StateSensor = StateSensor()
    mark: MarkSensor = MarkSensor()

    _check_imu = field_validator("imu")(checked_noise)


class RendezvousConfig(Model):
    """A rendezvous experiment.

    Attributes:
        seed: Seed of all missions.
        plugin_paths: Modules with further plugins, which are imported before any name is looked up.
        mission: Rates, guards and time limits.
        chaser: The chaser.
        target: The target's shape, inertia and mating point.
        tumble: The target's initial attitude and angular velocity; see `TumbleParameter`.
        sensors: The sensors of the chaser.
        estimator: Estimates the states of chaser and target from the measurements.
        planner: Plans the approach.
        bound: Bounds the error of the reference.
        tracker: Follows the reference.
    """

    seed: int = Field(default=0, ge=0, lt=2**64)
    plugin_paths: tuple[str, ...] = ()
    mission: MissionConfig = MissionConfig()
    chaser: ChaserConfig = ChaserConfig()
    target: _plugin("target_model", "EnvisatTarget")  # type: ignore[valid-type]
    tumble: _plugin("parameter", "TriAxialTumble")  # type: ignore[valid-type]
    sensors: SensorsConfig = SensorsConfig()
    estimator: _plugin("state_estimator", "MeasuredState")  # type: ignore[valid-type]
    planner: _plugin("approach_planner", "SplineSCPPlanner")  # type: ignore[valid-type]
    bound: ConformalBound = ConformalBound()
    tracker: _plugin("tracker", "TubeTracker")  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _check_parts(self) -> RendezvousConfig:
        problems: list[tuple[tuple[str, ...], str]] = []
        mission, sensors, reads = self.mission, self.sensors, self.estimator.reads
        steps = round(sensors.frame_period / mission.step)
        has_frames = "frames" in reads or "poses" in reads
        unknown = [name for name in reads if name not in get_args(Reading)]
        if unknown:
            message = f"its `reads` has {unknown[0]!r}; it must be a tuple of {', '.join(get_args(Reading))}"
            problems.append((("estimator",), message))
        if has_frames and (steps < 1 or abs(steps * mission.step - sensors.frame_period) > 1e-9):
            message = f"is not a multiple of the control step, {mission.step:g} s; round it"
            problems.append((("sensors", "frame_period"), f"{sensors.frame_period:g} s {message}"))
        unseen = mission.camera_silence + mission.update_period
        if has_frames and sensors.frame_period > unseen + 1e-9:
            message = (
                f"{sensors.frame_period:g} s between two frames are more than the {unseen:g} s, mission.camera_silence "
                f"({mission.camera_silence:g} s) and one update of the reference ({mission.update_period:g} s), after "
                "which the chaser retreats from a target that it does not see; lower it, or raise camera_silence"
            )
            problems.append((("sensors", "frame_period"), message))
        if "inertial" in reads and sensors.imu_ticks > mission.control_ticks:
            message = (
                f"{sensors.imu_ticks} ticks between two inertial samples are more than the {mission.control_ticks} "
                "ticks of a control step; lower it"
            )
            problems.append((("sensors", "imu_ticks"), message))
        box, position = self.chaser.limits.keep_in, self.chaser.position
        if box is None and mission.mean_motion:
            message = "on an orbit (mission.mean_motion > 0) chaser.limits.keep_in must be given: it bounds the tide"
            problems.append((("chaser", "limits", "keep_in"), message))
        if box is not None and any(abs(p) > half for p, half in zip(position, box, strict=True)):
            message = (
                f"the start is outside of the keep-in box, |x| <= {box[0]:g}, |y| <= {box[1]:g}, |z| <= {box[2]:g} m; "
                "move it, or enlarge chaser.limits.keep_in"
            )
            problems.append((("chaser", "position"), message))
        if problems:
            raise misplaced(problems)
        return self


@dataclass(frozen=True)
class Rendezvous(ResolvedExperiment):
    """A checked rendezvous experiment.

    Attributes:
        source: The file that it was loaded from.
        tree: The resolved configuration with the location of every value; loading it again gives the same experiment.
        config: The validated models.
    """

    config: RendezvousConfig


def load_rendezvous(path: str | os.PathLike[str], overrides: Iterable[str] = ()) -> Rendezvous:
    """Load and check an experiment file.

    Args:
        path: The experiment file.
        overrides: One ``path.of.keys=value`` for each value of the file to replace.

    Raises:
        ConfigError: The experiment is not valid; the error lists every mistake with its file, line and path of keys.
    """
    if isinstance(overrides, str):
        raise ConfigError(Problem("overrides must be a list of strings", hint=f"write [{overrides!r}]"))
    texts = list(overrides)
    tree = apply_overrides(_with_named(_mapping(load(path), path), texts), texts, RendezvousConfig)
    return build_rendezvous(_with_absolute_files(tree), os.fspath(path))


def _with_absolute_files(tree: LocatedDict) -> LocatedDict:
    """Return a tree in which the names of the files that plugins read are absolute.

    A relative name is looked up next to the configuration file that contains it, then where an included file would be;
    a name from the command line is relative to the working directory. A stored configuration can therefore be loaded
    from any working directory.
    """
    import_plugins(tree, ("plugin_paths",))
    for path, value, _ in list(written_values("file", tree, RendezvousConfig)):
        if isinstance(value, str) and value:
            tree = with_value(tree, path, _absolute(value, locate(tree, path)), None)
    return tree


def _absolute(name: str, location: Location | None) -> str:
    own = Path(os.path.abspath(location.file)) if location is not None and location.line else None
    path = Path(name).expanduser()
    tried = [(Path.cwd() if own is None else own.parent) / path, *places(os.fspath(path), own, own)]
    return os.path.normpath(next((place for place in tried if place.exists()), tried[0]))


def _with_named(tree: LocatedDict, overrides: Iterable[str]) -> LocatedDict:
    """Return a tree with every top-level key that an override changes; keys missing in the file have their defaults."""
    heads = [text.partition("=")[0].partition(".")[0] for text in overrides]
    for name, info in RendezvousConfig.model_fields.items():
        if name in heads and name not in tree:
            default = info.default
            if isinstance(default, str):
                default = LocatedDict({"functor": default, "config": LocatedDict()})
            elif isinstance(default, (BaseModel, tuple)):
                default = LocatedDict() if isinstance(default, BaseModel) else LocatedList()
            tree = with_value(tree, (name,), default, None)
    return tree


def is_rendezvous(path: str | os.PathLike[str]) -> bool:
    """Return whether a file is a rendezvous experiment: it has keys of one, and none of an inspection experiment."""
    try:
        tree = load(path)
    except ConfigError:
        return False
    keys = set(tree) if isinstance(tree, LocatedDict) else set()
    parts = set(RendezvousConfig.model_fields) - {"seed", "plugin_paths"}
    return bool(keys & parts) and not keys & set(ExperimentConfig.model_fields)


def build_rendezvous(tree: Any, source: str = "", overrides: Iterable[str] = ()) -> Rendezvous:
    """Check a resolved configuration and return its experiment.

    Args:
        tree: The resolved configuration.
        source: Name of the file that it was loaded from.
        overrides: One ``path.of.keys=value`` for each value to replace.

    Raises:
        ConfigError: The configuration is not valid; the error lists every mistake.
    """
    if not isinstance(tree, Mapping):
        raise ConfigError(Problem(f"a configuration must be a mapping of keys to values, not {tree!r:.60}"))
    if not isinstance(tree, LocatedDict):
        tree = LocatedDict(tree)
    tree = apply_overrides(tree, overrides, RendezvousConfig)
    import_plugins(tree, ("plugin_paths",))
    return Rendezvous(source, tree, validated(RendezvousConfig, tree))


def _mapping(tree: Any, path: str | os.PathLike[str]) -> LocatedDict:
    known = set(RendezvousConfig.model_fields)
    if not isinstance(tree, LocatedDict) or not known & set(tree):
        keys = ", ".join(f"`{key}`" for key in sorted(known))
        place = locate(tree, ()) if isinstance(tree, LocatedDict) else None
        hint = f"give the experiment file, not {os.path.basename(path)!r}"
        message = f"not a rendezvous experiment: the file has none of the keys {keys}"
        raise ConfigError(Problem(message, location=place, hint=hint))
    merged = tree.copy()
    for key in _MERGED:
        if isinstance(tree.get(key), list):
            merged[key] = merge(tree[key])
    return merged


def read_target(path: str | os.PathLike[str]) -> Target:
    """Read a target from a mesh of uniform density or from YAML with the key ``target``, such as an experiment.

    Raises:
        ConfigError: The file cannot be read, or has no target.
    """
    if Path(path).suffix.lower() in _MESHES:
        return MeshTarget(path=os.path.abspath(Path(path).expanduser()))()
    tree = load(path)
    if not isinstance(tree, LocatedDict) or "target" not in tree:
        raise ConfigError(
            f"{os.fspath(path)}: the file has no key `target`; give a rendezvous experiment, another YAML file with "
            "this key, or a mesh (.stl, .ply or .obj)"
        )
    part = LocatedDict({key: tree[key] for key in ("plugin_paths", "target") if key in tree}, tree.marks)
    return validated(RendezvousConfig, _with_absolute_files(part)).target()  # type: ignore[no-any-return]
