"""Frames, cleaned clouds, registrations and edges of front ends on fixed poses match the record.

A change that is meant to change them has to update the record:

    RECORD_RENDEZVOUS=1 python -m pytest -n 0 tests/rendezvous/perception/test_recorded_frames.py
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from safe_inspect.geometry.pointing import point_camera
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.depth_camera import DepthCamera, DepthFrame, TimeOfFlightCamera
from safe_inspect.rendezvous.front_end.base import FrontEnd, FrontEndContext, Registration, RelativeMotion, relative
from safe_inspect.rendezvous.front_end.cleaning import Cleaning, Cloud
from safe_inspect.rendezvous.front_end.gicp import prepared_cloud, register
from safe_inspect.rendezvous.front_end.model_registration import ModelRegistration, _spread_rotations, acquire
from safe_inspect.rendezvous.plugins import GicpSubmapFrontEnd, ModelFrontEnd
from safe_inspect.rendezvous.poses import Edge, inverse, perturbed, pose, rotation_exp
from safe_inspect.rendezvous.target.boxes import EnvisatTarget
from safe_inspect.types import FloatArray

from ..record import check
from .conftest import T_BC, spin

RECORD = Path(__file__).with_name("frames.json")
#: Half of the pixels along each side, and still more of them than one index of a stream gives.
CAMERA = TimeOfFlightCamera(width=112, height=85, focal_length=93.2)
TARGET = EnvisatTarget()()
STREAMS = Streams(3, np.zeros(1, np.int64), np.zeros(1, np.int64))
_SMALL = np.array([0.01, -0.012, 0.015, 0.006, -0.008, 0.004])


def _looking(position: tuple[float, ...], at: tuple[float, ...] = (0.0, 0.0, 0.0)) -> FloatArray:
    """Return T_MB of a chaser whose camera looks at a point."""
    return pose(point_camera(np.eye(3), np.array(position), np.array(at)) @ T_BC[:3, :3].T, np.array(position))


@cache
def _renderer(profile: str) -> Any:
    return CAMERA.model_copy(update={"profile": profile})(TARGET)


def _shot(chaser: FloatArray, number: int = 0, profile: str = "nominal", time: float = 0.0) -> DepthFrame:
    camera = chaser @ T_BC
    frame: DepthFrame = _renderer(profile).render(camera[:3, :3], camera[:3, 3], STREAMS, number, time)
    return frame


def _nothing(time: float) -> DepthFrame:
    depth = np.zeros((CAMERA.height, CAMERA.width))
    return DepthFrame(time, depth, np.zeros((0, 3)), depth > 0.0, ("out_of_view",))


def _frames() -> Any:
    places = {
        "ideal": (_looking((0.3, -1.4, 0.5)), "ideal"),
        "clean": (_looking((0.9, -1.1, -0.4)), "clean"),
        "harsh": (_looking((0.1, -0.9, 0.8)), "harsh"),
        "near": (_looking((0.2, -0.3, 0.3), (0.4, 0.0, 0.0)), "nominal"),
        "along the array": (_looking((2.2, -0.2, 0.1)), "nominal"),
        "far": (_looking((0.3, -4.2, 0.1)), "nominal"),
        "away": (_looking((0.0, -1.5, 0.0), (0.0, -3.0, 0.0)), "nominal"),
        "inside": (_looking((-0.05, 0.0, 0.0), (-0.6, 0.0, 0.0)), "ideal"),
    }
    found: dict[str, Any] = {}
    for number, (name, (place, profile)) in enumerate(places.items()):
        frame = _shot(place, number, profile, 0.5 * number)
        found[name] = [frame.time, frame.depth, frame.points, int(frame.valid.sum()), list(frame.flags)]
    other = DepthCamera(5, 4, 30.0, 0.2, 4.0, focal_length_y=40.0, principal_point=(1.5, 2.0))
    return found | {"rays": [other.directions, CAMERA.geometry.directions, *other.intrinsics]}


def _cloud(cloud: Cloud) -> Any:
    return [cloud.points, cloud.rays, cloud.ranges, cloud.silhouette, cloud.outwards, cloud.nearest]


def _clouds() -> Any:
    frame, found = _shot(_looking((0.3, -1.4, 0.5))), {}
    depth, valid = frame.depth.copy(), frame.valid.copy()
    depth[2:6, 2:7], valid[2:6, 2:7] = 3.0, True  # what flies far away
    depth[10:26, 80:104], valid[10:26, 80:104] = 0.9 + 0.02 * np.arange(24), True  # a large part with steps
    for name, one in (
        ("plain", frame), ("more", replace(frame, depth=depth, valid=valid)), ("nothing", _nothing(0.0)),
    ):  # fmt: skip
        cloud = Cleaning(CAMERA.geometry)(one, T_BC)
        found[name] = [*_cloud(cloud), *_cloud(Cleaning(CAMERA.geometry, 0.015)(one, T_BC).thinned(40))]
    return found


def _registration() -> ModelRegistration:
    return ModelFrontEnd().registration(TARGET, CAMERA.geometry, T_BC)


def _found(one: Registration) -> Any:
    return [one.pose, one.hessian, one.score, one.inliers, one.excess, one.systematic, one.covariance(2.0)]


def _registrations() -> Any:
    registration, cleaning, found = _registration(), Cleaning(CAMERA.geometry, edge=np.inf), {}
    places = {
        "usual": _looking((0.3, -1.4, 0.5)),
        "near": _looking((0.2, -0.5, 0.25), (0.3, 0.0, 0.0)),
        "very near": _looking((0.55, -0.15, 0.32), (0.5, 0.0, 0.0)),
        "along the array": _looking((1.9, -0.25, 0.15)),
    }
    for number, (name, truth) in enumerate(places.items()):
        cloud, start = cleaning(_shot(truth, number), T_BC), perturbed(truth, _SMALL)
        for coarse, widening in ((False, 1.0), (True, 2.5)):
            for at in (truth, start, perturbed(truth, -4.0 * _SMALL)):
                one, gradient = registration.linearise(cloud, at, widening, coarse=coarse)
                key = f"{name} {widening:g} {len(found)}"
                found[key] = [one.hessian, gradient, one.score, one.inliers, one.excess]
        prior = np.diag(np.repeat([30.0, 100.0], 3) ** 2)
        fits = registration(cloud, start), registration(cloud, start, prior), registration(
            cloud, perturbed(truth, 9.0 * _SMALL), iterations=2, widening=3.0, coarse=True)  # fmt: skip
        between, covariance = relative(fits[0], fits[1])
        found[name] = [*map(_found, fits), between, covariance]
    return [list(found.values()), registration.surface.patches, *registration.coarse_samples]


def _searches() -> Any:
    found = []
    for number, place in enumerate(((0.3, -1.4, 0.5), (0.2, 0.4, -1.5))):
        cloud = Cleaning(CAMERA.geometry, edge=np.inf)(_shot(_looking(place), number), T_BC)
        found.append([[one.pose, one.score, one.inliers] for one in acquire(_registration(), cloud, 90, 3)])
    return [*found, _spread_rotations(7)]


def _pairs() -> Any:
    one, other = (Cleaning(CAMERA.geometry)(_shot(at, 0, "clean"), T_BC).points for at in spin(2))
    first, second = prepared_cloud(one), prepared_cloud(other)
    fit, poor = register(first, second, np.eye(4)), register(first, second, pose(np.eye(3), np.full(3, 0.4)))
    return [len(first), first.points, *_found(fit), fit.covariance(), poor.pose, poor.inliers]


def _motions() -> Any:
    motion, found, gyro = (
        RelativeMotion(0.0, _looking((0.3, -1.4, 0.5))),
        [],
        rotation_exp(np.array([0.01, 0.0, -0.02])),
    )
    for k, time in enumerate((1.0, 1.5, 3.0, 3.0, 4.0)):
        motion.turned(gyro)
        found.append(motion.predict(time))
        motion.observe(time, perturbed(found[-1], (0.3 + k) * _SMALL))
    return found


def _edges(steps: list[list[Edge]]) -> Any:
    return [
        [[one.first, one.second, one.kind, one.inliers, one.pose, one.covariance] for one in edges] for edges in steps
    ]


def _flown(front_end: FrontEnd, target: Any) -> Any:
    """Return edges of a sequence that is interrupted, of which some frames are predicted, one of them badly."""
    run = front_end(FrontEndContext(CAMERA.geometry, T_BC, target, STREAMS))
    truth, steps = [*spin(12, period=2.0), *spin(5, period=2.0, first=(-1.2, 0.4, 2.0))], []
    blank = {0, 5, 9, 10, 11}
    for k, at in enumerate(truth):
        time, rotation = 2.0 * k, rotation_exp(np.array([0.0, 1e-3, 0.0]))
        predicted = inverse(truth[1]) @ at if k > 2 else None
        if k == 7 and predicted is not None:
            predicted = perturbed(predicted, 5.0 * _SMALL)
        steps.append(run.step(_nothing(time) if k in blank else _shot(at, k, "nominal", time), predicted, rotation))
    return _edges(steps)


def _submaps() -> Any:
    there = spin(10, period=2.6)
    truth = [*there, *there[::-1]]
    run = GicpSubmapFrontEnd(submap=4)(FrontEndContext(CAMERA.geometry, T_BC, None, STREAMS))
    steps = [
        run.step(_shot(at, k, "clean", 2.6 * k), inverse(truth[0]) @ at if k else None, np.eye(3))
        for k, at in enumerate(truth)
    ]
    return [_edges(steps), [[one.number, one.pose, one.cloud.points] for one in run.keyframes]]


def _loops() -> Any:
    """Return the loops of a view that several earlier keyframes are near to."""
    run = GicpSubmapFrontEnd(submap=3)(FrontEndContext(CAMERA.geometry, T_BC, None, STREAMS))
    truth = spin(16, period=0.7)
    clouds = [prepared_cloud(Cleaning(CAMERA.geometry)(_shot(at, 0, "clean"), T_BC).points) for at in truth]
    for k, (at, cloud) in enumerate(zip(truth, clouds, strict=True)):
        run._add(k, inverse(truth[0]) @ at, cloud)
    found = [run._loops(20 + k, inverse(truth[0]) @ truth[k], clouds[k]) for k in (1, 2, 3, 4, 9, 14)]
    back = [run._relocalise(clouds[k]) for k in (14, 2)]
    return [
        _edges(found),
        _edges([run._skips(30, inverse(truth[0]) @ truth[15], clouds[14])]),
        [None if one is None else [one.pose, one.inliers] for one in back],
    ]


PIECES: dict[str, Callable[[], Any]] = {
    "frames": _frames, "clouds": _clouds, "registrations": _registrations, "searches": _searches, "pairs": _pairs,
    "motions": _motions, "known shape": lambda: _flown(ModelFrontEnd(), TARGET),
    "unknown shape": lambda: _flown(GicpSubmapFrontEnd(), None), "submaps": _submaps, "loops": _loops,
}  # fmt: skip


@pytest.mark.parametrize("name", PIECES)
def test_perception_matches_the_record(name: str) -> None:
    check(RECORD, name, PIECES[name](), tolerance=1e-3 if name in ("clouds", "motions") else None)
