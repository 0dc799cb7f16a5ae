"""Checks of an experiment before a mission is flown: values that are valid each but do not match each other."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from safe_inspect.config.fields import written_values
from safe_inspect.config.loading.located import LocatedDict, locate, path_text
from safe_inspect.dynamics.tumble import largest_rate, tumble
from safe_inspect.errors import ConfigError, InitialStateError, PluginValueError, Problem
from safe_inspect.plugins.results import called, require_arrays, require_type
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.coordination.context import clearances
from safe_inspect.rendezvous.estimation.mapping import START_DISTANCE
from safe_inspect.rendezvous.experiment import Rendezvous, RendezvousConfig
from safe_inspect.rendezvous.front_end.model import TYPICAL_RANGE
from safe_inspect.rendezvous.planner.problem import Path, to_inertial
from safe_inspect.rendezvous.plugins import ModelFrontEnd, PipelineEstimator
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.simulators.resets.parameters import Draw
from safe_inspect.tasks.docking.tumble_parameter import tumble_states
from safe_inspect.types import FloatArray

#: Largest rotation of the target from frame to frame that estimation was tested with [rad]; tests flew 8 deg/s at 1 Hz.
_LARGEST_TURN = np.deg2rad(10.0)
#: Time between the last inertial sample and a frame in which a pose moves by less than its error [s].
_LARGEST_LAG = 0.01
#: Largest ratio of the camera's noise to that which the front end assumes.
_MOST_NOISE = 1.5
#: Times at which the mating point's motion is evaluated [s].
_TIMES = np.arange(0.0, 600.0, 1.0)
#: Units for which a user may have meant degrees where a number has no unit.
_ANGLES = ("rad", "rad/s")
#: Time in which the chaser must be able to reach the target: an hour [s].
_HOUR = 3600.0
#: Largest number of missions whose tumbles are sampled for the checks.
_MOST_DRAWN = 100


def checked_target(config: RendezvousConfig) -> Target:
    """Return the target of an experiment after checking that the chaser can reach its mating point.

    Raises:
        ConfigError: The target is not a rigid body, or its mating point is out of reach at every attitude.
    """
    chaser = config.chaser
    try:
        target: Target = config.target()
        require_type(call := called(config.target), target, Target)
        require_arrays(call, (("mating_point", target.mating_point, (3,)), ("inertia", target.inertia, (3, 3))))
        principal = target.principal
    except ConfigError as error:  # The mistake is in a file, which is not a key of the experiment.
        problems = [replace(problem, path=problem.path or "target.config") for problem in error.problems]
        raise ConfigError(problems) from None
    except (ValueError, PluginValueError) as error:
        raise ConfigError(Problem(str(error), "target.config")) from None
    point, path = target.mating_point, "target.config.mating_point"
    distance = float(np.linalg.norm(point))
    if not np.isfinite(principal).all() or not distance > 0.0:
        raise ConfigError(Problem("the mating point is the target's centre of mass", path, hint="give a point outside"))
    spare = float(target.solid.distance((target.R_MT @ point)[None])[0]) - chaser.radius
    if spare < 0.0:
        message = f"the chaser, a sphere of {chaser.radius:g} m, would overlap the target by {-spare:.3g} m there"
        raise ConfigError(Problem(message, path, hint="move the point outwards"))
    box = chaser.limits.keep_in
    if box is not None and distance > np.linalg.norm(box):
        message = f"the point is {distance:.3g} m from the centre of mass, farther than any corner of the keep-in box"
        raise ConfigError(Problem(message, path, hint="move the point inwards, or enlarge chaser.limits.keep_in"))
    return target


def check_start(config: RendezvousConfig, target: Target, orientation: np.ndarray) -> None:
    """Check that the chaser does not touch the target at the start.

    Args:
        config: The experiment.
        target: The target of the experiment.
        orientation: The target's attitude q_WT at the start, shape (4,).

    Raises:
        ConfigError: The chaser overlaps the target.
    """
    spare = clearances(target, np.array([config.chaser.position]), orientation[None], config.chaser.radius)[0]
    if spare < 0.0:
        message = f"the chaser would overlap the target by {-spare:.3g} m at the start"
        raise ConfigError(Problem(message, "chaser.position", hint="start farther away"))


def mission_streams(config: RendezvousConfig, *numbers: int) -> Streams:
    """Return the random streams of missions, one row for each."""
    return Streams(config.seed, np.array(numbers), np.zeros(len(numbers), np.int64))


def initial_tumbles(config: RendezvousConfig, streams: Streams) -> tuple[FloatArray, FloatArray]:
    """Return the target's initial attitudes q_WT, shape (n, 4), and angular velocities in T [rad/s], shape (n, 3).

    Args:
        config: The experiment.
        streams: Random streams with a row for each mission.

    Raises:
        ConfigError: The parameter does not give an attitude and an angular velocity for each mission.
    """
    try:
        return tumble_states(config.tumble.registered_name, config.tumble(Draw(streams, "tumble")), len(streams))
    except InitialStateError as error:
        raise ConfigError(Problem(str(error), "tumble")) from None


def check_scenario(experiment: Rendezvous, missions: int = 1) -> list[Problem]:
    """Check an experiment before it is flown, and return its doubtful values, each with its location.

    Args:
        experiment: The experiment.
        missions: Number of missions; the tumbles of at most the first hundred are sampled.

    Raises:
        ConfigError: The experiment cannot be flown; the error states the location of the value.
    """
    config, tree = experiment.config, experiment.tree
    try:
        target = checked_target(config)
        attitudes, rates = initial_tumbles(config, mission_streams(config, *range(min(missions, _MOST_DRAWN))))
        check_start(config, target, attitudes[0])
        _check_rates(config, target, rates)
        doubts = [*_sensor_doubts(config, target, rates), *_motion_doubts(config, target, attitudes, rates)]
    except ConfigError as error:
        raise ConfigError([_placed(problem, tree) for problem in error.problems]) from None
    return [*(_placed(doubt, tree) for doubt in doubts), *_bare_angles(tree)]


def _placed(problem: Problem, tree: LocatedDict) -> Problem:
    if problem.location is not None or not problem.path:
        return problem
    return replace(problem, location=locate(tree, problem.path.split(".")))


def _bare_angles(tree: LocatedDict) -> Iterator[Problem]:
    """Yield a problem for each number without a unit that is read as radians but may be meant as degrees."""
    for path, value, symbol in written_values("units", tree, RendezvousConfig):
        if symbol in _ANGLES and isinstance(value, (int, float)) and value != 0.0:
            degrees = f"{np.rad2deg(value):.4g} {symbol.replace('rad', 'deg')}"
            message = f"{value:g} has no unit and is read as {value:g} {symbol}, which is {degrees}"
            yield Problem(message, path_text(path), locate(tree, path), "write the unit")


def _check_rates(config: RendezvousConfig, target: Target, rates: FloatArray) -> None:
    """Check that the control step is short enough for the motion, and that the chaser can reach the target at all.

    Raises:
        ConfigError: The control step is too long, or the chaser cannot reach the target.
    """
    chaser, step, length = config.chaser, config.mission.step, config.mission.length
    limits = chaser.limits
    turn = max(math.hypot(*rate) for rate in rates) * step
    way = math.hypot(*chaser.position) - math.hypot(*target.mating_point)
    # The chaser accelerates as much as it can over half of the distance, and decelerates over the rest.
    reached = math.hypot(*chaser.velocity) * _HOUR + 0.25 * math.sqrt(3.0) * limits.force / chaser.mass * _HOUR**2
    circle, around = math.hypot(*chaser.position[:2]), config.mission.fly_around
    speed = 2.0 * math.pi * circle / around if around else 0.0
    across = math.inf if limits.keep_in is None else min(limits.keep_in[:2])
    moved, turned = 0.5 * step**2 * (limits.force / chaser.mass), 0.5 * step**2 * (limits.torque / min(chaser.inertia))
    during, pushed = f"in a control step of {step:g} s", f"{limits.force:g} N move {chaser.mass:g} kg by"
    checks = (
        (turn < math.pi, _rate_path(config), "lower the rate; less than half a turn can be followed",
         f"the target turns by {math.degrees(turn):.3g} deg {during}"),
        (reached >= way, "chaser.mass", "correct it, or chaser.limits.force",
         f"{pushed} {reached:.2g} m in an hour; the target is {way:.2g} m away"),
        (moved <= length, "chaser.mass", "correct it, or chaser.limits.force", f"{pushed} {moved:.2g} m {during}"),
        (turned <= math.pi, "chaser.inertia", "correct it, or chaser.limits.torque",
         f"{limits.torque:g} N m turn it by {math.degrees(turned):.2g} deg {during}"),
        (speed <= limits.tracking_speed, "mission.fly_around", "take more time",
         f"the chaser flies around at {speed:.3g} m/s; the tracking speed is {limits.tracking_speed:g} m/s"),
        (not around or circle <= across, "mission.fly_around", "enlarge chaser.limits.keep_in, or take 0 s",
         f"a circle of {circle:.3g} m around the target leaves the keep-in box of {across:g} m"),
    )  # fmt: skip
    problems = [Problem(message, path, hint=hint) for fits, path, hint, message in checks if not fits]
    if problems:
        raise ConfigError(problems)


def _sensor_doubts(config: RendezvousConfig, target: Target, rates: FloatArray) -> Iterator[Problem]:
    """Yield a problem for each value with which the sensors may not show the target.

    Raises:
        ConfigError: The camera cannot see the target from the start.
    """
    sensors, mission, reads = config.sensors, config.mission, config.estimator.reads
    if "frames" not in reads and "poses" not in reads:
        return
    reach, path = sensors.camera.geometry.largest_range, "chaser.position"
    distance = float(np.linalg.norm(config.chaser.position))
    nearest = distance - target.swept_radius - float(np.linalg.norm(config.chaser.camera_position))
    seen = f"the target's centre is {distance:.3g} m away, and the camera measures up to {reach:g} m"
    if nearest > reach:
        raise ConfigError(Problem(f"{seen}: it sees nothing of the target", path, hint="start nearer"))
    if distance > reach:
        yield Problem(f"{seen}: it sees a part of the target at most", path, hint="start nearer")
    least, (ahead, *aside) = sensors.camera.least_range, config.chaser.camera_position
    away = math.hypot(math.dist(target.landmark, target.mating_point) - ahead, *aside)
    if "frames" in reads and away < least:
        message = (
            f"the camera measures from {least:g} m, and at the mating point it looks at a corner {away:.3g} m away"
        )
        yield Problem(message, "sensors.camera.least_range", hint="lower it, or move the mating point outwards")
    known = config.estimator.known(target)
    if known is not target and distance < (least := known.swept_radius + config.chaser.radius + START_DISTANCE):
        message = (
            f"the chaser starts {distance:.3g} m away, and the ball that contains the target requires {least:.3g} m"
        )
        yield Problem(message, "estimator.config.radius", hint="lower it, or start farther away")
    front_end = getattr(config.estimator, "front_end", None)
    if isinstance(front_end, ModelFrontEnd):
        length = mission.length
        measured, assumed = sensors.camera.noise.at(TYPICAL_RANGE * length), front_end.range_noise * length
        if measured > _MOST_NOISE * assumed:
            found, believed = (f"{1e3 * sigma:.3g} mm" for sigma in (measured, assumed))
            typical = f"{TYPICAL_RANGE * length:g} m"
            message = f"ranges of {typical} scatter by {found}, and the front end assumes {believed}"
            hint = "set range_sigma and range_growth of the front end" + (
                "" if length == 1.0 else ", or sensors.camera.scale"
            )
            yield Problem(message, "sensors.camera.profile", hint=hint)
    frame_ticks = round(sensors.frame_period / mission.tick)
    lag = (sensors.imu_ticks - math.gcd(sensors.imu_ticks, frame_ticks)) * mission.tick
    if "inertial" in reads and lag > _LARGEST_LAG:
        message = f"the last inertial sample is up to {1e3 * lag:g} ms older than a frame"
        hint = f"take a divisor of the {frame_ticks} ticks between two frames"
        yield Problem(message, "sensors.imu_ticks", hint=hint)
    turn = float(largest_rate(target.principal, rates).max()) * sensors.frame_period
    if turn > _LARGEST_TURN:
        found, tested = (f"up to {angle:.3g} deg" for angle in np.rad2deg((turn, _LARGEST_TURN)))
        message = f"the target turns by {found} from frame to frame; estimation is tested {tested}"
        yield Problem(message, _rate_path(config), hint="lower the rate, or sensors.frame_period")
    if isinstance(config.estimator, PipelineEstimator) and not config.estimator.known_target:
        message = "without a known shape the directions of the target's axes are ambiguous, and no approach is planned"
        yield Problem(message, "estimator.config.known_target")


def _motion_doubts(
    config: RendezvousConfig, target: Target, attitudes: FloatArray, rates: FloatArray
) -> Iterator[Problem]:
    """Yield a problem for each value with which the chaser may not be able to do what a plan demands."""
    limits, lag, mission = config.chaser.limits, config.chaser.actuator.lag, config.mission
    if mission.time_limit <= mission.checkout + mission.observe:
        message = (
            f"the mission ends after {mission.time_limit:g} s at the latest; checkout and observation take "
            f"{mission.checkout:g} s and {mission.observe:g} s, so that no approach starts"
        )
        yield Problem(message, "mission.time_limit", hint="raise it, or lower mission.observe")
    if mission.observe > mission.observe_limit:
        message = (
            f"{mission.observe:g} s are more than mission.observe_limit, {mission.observe_limit:g} s, which ends every "
            "observation, however accurate"
        )
        yield Problem(message, "mission.observe", hint="lower it, or raise mission.observe_limit")
    if lag > 0.0:
        message = f"the tube does not include that the actuators lag by {lag:g} s, so the chaser may leave it"
        yield Problem(message, "chaser.actuator.lag", hint=f"keep it far below the control step of {mission.step:g} s")
    spin = min(float(largest_rate(target.principal, rates).max()), limits.line_of_sight_rate)
    spun, longest = max(config.chaser.inertia) * spin / limits.torque, max(mission.durations)
    if spun > longest:
        message = (
            f"{limits.torque:g} N m need {spun:.3g} s to turn the chaser as fast as its line of sight, "
            f"{math.degrees(spin):.3g} deg/s; an approach takes {longest:g} s"
        )
        yield Problem(message, "chaser.limits.torque", hint="raise it, or correct chaser.inertia")
    fastest = max(map(abs, config.chaser.velocity))
    if fastest > limits.tracking_speed:
        message = (
            f"the chaser starts at {fastest:g} m/s along an axis; the tracking speed is {limits.tracking_speed:g} m/s"
        )
        yield Problem(message, "chaser.velocity", hint="start slower, or raise chaser.limits.tracking_speed")
    point = Path(target.mating_point, np.zeros(3), np.zeros(3))
    turned = tumble(target.principal, attitudes, rates, _TIMES)
    _, velocity, acceleration = to_inertial(target.principal, *turned, point)
    speed = np.abs(velocity).max(axis=-1)
    force = config.chaser.mass * np.abs(acceleration).max(axis=-1)
    never = np.flatnonzero(~((speed <= limits.speed) & (force <= limits.planned_force)).any(axis=1))
    if len(never):
        first = never[0]
        which = "" if len(attitudes) == 1 else f" in {len(never)} of {len(attitudes)} missions, such as {first},"
        needed = f"{speed[first].min():.3g} m/s and {force[first].min():.3g} N along an axis"
        allowed = f"{limits.speed:g} m/s and {limits.planned_force:g} N"
        message = f"following the mating point{which} takes at least {needed}; the limits are {allowed}"
        yield Problem(message, _rate_path(config), hint="lower the rate, or move the mating point inwards")


def _rate_path(config: RendezvousConfig) -> str:
    names = [name for name in ("rate", "largest_rate") if name in type(config.tumble).model_fields]
    return ".".join(["tumble", *(["config", names[0]] if names else [])])
