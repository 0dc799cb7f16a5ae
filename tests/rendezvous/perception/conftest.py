"""Frames of a target at known poses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from safe_inspect.geometry.pointing import R_BC
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.depth_camera import DepthFrame, TimeOfFlightCamera
from safe_inspect.rendezvous.poses import inverse, pose, rotation_exp
from safe_inspect.rendezvous.target.boxes import EnvisatTarget
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import FloatArray

#: Where the camera is in B.
T_BC = pose(R_BC, np.array([0.13, 0.0, 0.0]))
CAMERA = TimeOfFlightCamera().geometry

Shoot = Callable[..., DepthFrame]


@pytest.fixture(scope="session")
def target() -> Target:
    return EnvisatTarget()()


@pytest.fixture(scope="session")
def streams() -> Streams:
    return Streams(3, np.zeros(1, np.int64), np.zeros(1, np.int64))


@pytest.fixture(scope="session")
def shoot(target: Target, streams: Streams) -> Shoot:
    """Takes a frame at T_MB."""

    def take(chaser: FloatArray, number: int = 0, profile: str = "nominal", time: float = 0.0) -> DepthFrame:
        camera = chaser @ T_BC
        renderer = TimeOfFlightCamera(profile=profile)(target)
        return renderer.render(camera[:3, :3], camera[:3, 3], streams, number, time)

    return take


def spin(count: int, period: float = 1.0, rate: float = 5.0, first: tuple[float, ...] = (0.4, 1.1, -0.3)) -> list:
    """Return T_MB of a chaser at rest 1.5 m from a target that spins evenly, at `count` frames."""
    rate_vector = np.deg2rad(rate) * np.array([0.7, 0.5, 0.5]) / np.linalg.norm([0.7, 0.5, 0.5])
    level = pose(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([0.0, -1.5, 0.0]))
    start = rotation_exp(np.array(first))
    turns = [pose(start @ rotation_exp(rate_vector * period * k), np.zeros(3)) for k in range(count)]
    return [inverse(turn) @ level for turn in turns]
