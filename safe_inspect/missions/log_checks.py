"""Plausibility checks of a sensor log: wrong units, different clocks and gaps, which no single value shows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from safe_inspect.errors import ConfigError, Problem
from safe_inspect.missions.sensor_log import FRAMES, IMU, TRUTH, TRUTH_PARTS, SensorLog
from safe_inspect.types import FloatArray

#: Number of frames, spread over the log, whose depths are checked.
_LOOKED_AT = 5
#: Shortest gap between two inertial samples that is too long, in periods, and its lower limit [s].
_LONG_GAP, _LEAST_GAP = 10.0, 0.1
#: Time between two frames above which the times are probably not in seconds [s].
_SLOW_FRAMES = 60.0
#: Scatter of inertial samples relative to the stated noise, and medians of the angular velocity [rad/s] and of the
#: specific force [m/s^2], above which the unit is doubtful. In free fall the specific force is that of the thrusters.
_SCATTER, _FAST, _STRONG = 10.0, 1.0, 1.0
#: Factor from the median absolute second difference of samples with independent errors to their standard deviation.
_FROM_SECOND = 1.4826 / np.sqrt(6.0)


def check_log(log: SensorLog) -> list[Problem]:
    """Return the doubtful properties of a log, each with its file and what to do.

    Raises:
        ConfigError: Nothing can be estimated from the log: it has no inertial samples during the time of the frames, or
            no depth within the camera's range.
    """
    imu = str(log.folder / IMU)
    _check_samples(log, imu)
    _check_depths(log)
    return [*_clock_doubts(log, imu), *_unit_doubts(log, imu), *_truth_doubts(log)]


def _check_samples(log: SensorLog, name: str) -> None:
    first, last = log.times[0], log.times[-1]
    if not len(log.imu):
        raise ConfigError(
            f"{name}: there are no samples; give samples for the time of the frames, {first:g} to {last:g} s. A camera "
            "that does not move has samples of 0"
        )
    since, until = log.imu[0, 0], log.imu[-1, 0]
    if until <= first or since >= last:
        raise ConfigError(
            f"{name}: its samples are from {since:.10g} to {until:.10g} s, and the frames from {first:.10g} to "
            f"{last:.10g} s; use one clock for both"
        )


def _check_depths(log: SensorLog) -> None:
    camera = log.description.camera
    outside: list[FloatArray] = []
    for index in np.unique(np.linspace(0, len(log) - 1, _LOOKED_AT).astype(int)):
        frame, depth = log.frame(int(index)), log.depth(int(index))
        if len(frame.points):
            return
        outside.append(depth[depth != 0.0])
    found = np.concatenate(outside)
    if len(found):
        raise ConfigError(
            f"{log.folder / log.files[0]}: none of {len(outside)} frames has a depth in the camera's range of "
            f"{camera.least_range:g} to {camera.largest_range:g} m; their median is {np.median(found):.4g} m. NPZ "
            f"files must be in metres, PNG files in units of depth_unit ({camera.depth_unit:g} m); z is positive in "
            "front of the camera"
        )


def _clock_doubts(log: SensorLog, name: str) -> Iterator[Problem]:
    """Yield a problem for each gap between samples, and for times that are probably not in seconds."""
    frames, times = log.times, log.imu[:, 0]
    step = float(np.median(np.diff(times))) if len(times) > 1 else np.inf
    long = max(_LONG_GAP * step if np.isfinite(step) else 0.0, _LEAST_GAP)
    # The first and the last frame count as samples, so that gaps at the ends are found like others.
    inside = times[(times > frames[0]) & (times < frames[-1])]
    ends = np.concatenate([[frames[0]], inside, [frames[-1]]])
    for place in np.flatnonzero(np.diff(ends) > long)[:3]:
        yield Problem(
            f"{name}: there is no sample from {ends[place]:.10g} to {ends[place + 1]:.10g} s; the chaser's motion in "
            "that time is unknown",
            hint="record samples for as long as frames are recorded",
        )
    period = float(np.median(np.diff(frames)))
    if period > _SLOW_FRAMES:
        yield Problem(f"{log.folder / FRAMES}: the frames are {period:.4g} s apart", hint="give the times in seconds")


def _unit_doubts(log: SensorLog, name: str) -> Iterator[Problem]:
    """Yield a problem for samples that are probably not in SI units, or not of a chaser in free fall."""
    noise, samples = log.description.imu, log.imu[:, 1:]
    used = samples[(log.imu[:, 0] >= log.times[0]) & (log.imu[:, 0] <= log.times[-1])]
    for what, unit, stated, values, most, hint in (
        ("angular velocity", "rad/s", noise.rate, used[:, 3:], _FAST, "give radians per second, not degrees"),
        ("specific force", "m/s^2", noise.acceleration, used[:, :3], _STRONG, "leave gravity out, and give m/s^2"),
    ):
        typical = float(np.median(np.linalg.norm(values, axis=1)))
        scatter = float(_FROM_SECOND * np.median(np.abs(np.diff(values, 2, axis=0)))) if len(values) > 2 else 0.0
        if typical > most:
            yield Problem(f"{name}: the median {what} is {typical:.3g} {unit}", hint=hint)
        elif stated > 0.0 and scatter > _SCATTER * stated:
            yield Problem(
                f"{name}: the {what} scatters by {scatter:.3g} {unit} from sample to sample, {scatter / stated:.3g} "
                f"times what `imu` states ({stated:g})",
                hint=f"{hint}, or correct `imu`",
            )


def _truth_doubts(log: SensorLog) -> Iterator[Problem]:
    if log.truth is None:
        return
    apart = float(np.abs(log.truth[:, 0] - log.times).max())
    if apart > 1e-3:
        yield Problem(f"{log.folder / TRUTH}: its times differ from the frames' by up to {apart:.4g} s")
    for name in ("q_MB", "q_WT"):
        error = np.abs(np.linalg.norm(log.truth[:, TRUTH_PARTS[name]], axis=1) - 1.0)
        if error.max() > 1e-3:
            yield Problem(f"{log.folder / TRUTH}: {name} is not a unit quaternion in row {error.argmax()}")
