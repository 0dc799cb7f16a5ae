"""What the parts of the registration to a known shape are worth: single frames, from 1.5 degrees and 1.5 cm of error.

python benchmarks/rendezvous_registration.py [--profile nominal] [--seeds 3] [--period 3]

Then how much worse the score of the shape is that is turned by half a turn about its long axis, and what errors of
attitude are at the mating point, with the camera on the landmark.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np

from safe_inspect.geometry.pointing import R_BC, point_camera
from safe_inspect.missions.sensor_log_writer import WatchedFrame, watch
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.depth_camera import PROFILES, DepthRenderer, TimeOfFlightCamera
from safe_inspect.rendezvous.experiment import RendezvousConfig, SensorsConfig
from safe_inspect.rendezvous.front_end import model_registration as module
from safe_inspect.rendezvous.front_end.cleaning import Cleaning, Cloud
from safe_inspect.rendezvous.front_end.model_registration import ModelRegistration
from safe_inspect.rendezvous.front_end.residuals import RangeNoise, add_surface
from safe_inspect.rendezvous.plugins import ModelFrontEnd
from safe_inspect.rendezvous.poses import difference, perturbed, pose, rotation_exp
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.rendezvous.target.surface import MeshSurface, Offsets, SurfacePoints
from safe_inspect.types import FloatArray

_INFORMATION = np.diag(np.repeat([np.deg2rad(2.0), 0.02], 3) ** -2.0)


def _no_outline(*_: Any) -> tuple[float, int]:
    return 0.0, 0


def _all_of_them(self: SurfacePoints, _: FloatArray) -> SurfacePoints:
    return self


def _within_edges(self: MeshSurface, samples: SurfacePoints, positions: FloatArray) -> Offsets:
    found = _NEAREST(self, samples, positions)
    return found._replace(beyond=np.zeros_like(found.beyond))


def _all_edges(
    sums: FloatArray, surface: MeshSurface, samples: SurfacePoints, at: FloatArray, cloud: Cloud, noise: RangeNoise
) -> tuple[float, int]:
    everywhere = replace(cloud, at_boundary=np.ones_like(cloud.at_boundary))
    return add_surface(sums, surface, samples, at, everywhere, noise)


_NEAREST = MeshSurface.nearest
#: Name, prior or not, cut [m], edges of the depth image that are dropped [m], and what is patched.
_VARIANTS: tuple[tuple[str, bool, float, float, Callable[[], AbstractContextManager[Any]]], ...] = (
    ("as it is", True, 0.03, np.inf, nullcontext),
    ("no silhouette", True, 0.03, np.inf, lambda: patch.object(module, "add_silhouette", _no_outline)),
    ("no distance beyond edges", True, 0.03, np.inf, lambda: patch.object(MeshSurface, "nearest", _within_edges)),
    ("beyond all edges", True, 0.03, np.inf, lambda: patch.object(module, "add_surface", _all_edges)),
    ("the rear too", True, 0.03, np.inf, lambda: patch.object(SurfacePoints, "facing", _all_of_them)),
    ("no prior", False, 0.03, np.inf, nullcontext),
    ("cut 2 cm", True, 0.02, np.inf, nullcontext),
    ("cut 6 cm", True, 0.06, np.inf, nullcontext),
    ("no pixels next to a jump", True, 0.03, 0.03, nullcontext),
)


def _print_half_turn(
    registration: ModelRegistration, cleaning: Cleaning, seen: list[WatchedFrame], mount: FloatArray
) -> None:
    """Print by how much the half turn about x of M scores worse than the truth."""
    half, differences = pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3)), []
    for one in seen:
        cloud = cleaning(one.frame, mount)
        wrong = registration(cloud, half @ one.T_MB, iterations=25, widening=2.5)
        differences.append(1e3 * (wrong.score - registration(cloud, one.T_MB).score))
    print(f"half turn: {min(differences):.2f} mm worse at least, median {np.median(differences):.2f}", flush=True)


def _print_errors_at_mating_point(
    name: str, registration: ModelRegistration, cleaning: Cleaning, target: Target, mount: FloatArray, count: int = 60
) -> None:
    """Print errors of a variant and their ratio to the covariance near the mating point."""
    random, streams = np.random.default_rng(0), Streams(0, np.zeros(1, np.int64), np.zeros(1, np.int64))
    renderer = DepthRenderer(cleaning.camera, target.mesh, PROFILES["nominal"])
    place, corner = target.R_MT @ target.mating_point, target.R_MT @ target.landmark
    errors, nees = [], []
    for number in range(count):
        position = place + 0.01 * random.normal(size=3)
        camera = point_camera(rotation_exp(random.uniform(-np.pi, np.pi) * place), position, corner)
        truth = pose(camera @ mount[:3, :3].T, position)
        start = perturbed(truth, random.normal(size=6) * np.repeat([np.deg2rad(0.1), 2e-3], 3))
        eye = truth @ mount
        cloud = cleaning(renderer.render(eye[:3, :3], eye[:3, 3], streams, number, 0.0), mount)
        found = registration(cloud, start, _INFORMATION)
        turn = difference(truth, found.pose)[:3]
        errors.append(np.rad2deg(np.linalg.norm(turn)))
        nees.append(turn @ np.linalg.solve(found.covariance()[:3, :3], turn) / 3.0)
    print(f"at the mating point, {name}: {count} frames  median {np.median(errors):.2f}  95th percentile "
          f"{np.percentile(errors, 95):.2f} degrees  NEES for each degree of freedom {np.mean(nees):.2f}")  # fmt: skip


def main() -> None:
    """Print the errors of each variant."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--profile", choices=("clean", "nominal", "harsh"), default="nominal")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--period", type=float, default=3.0, help="time between two frames [s]")
    arguments = parser.parse_args()
    camera = TimeOfFlightCamera(profile=arguments.profile)
    config = RendezvousConfig(sensors=SensorsConfig(camera=camera, frame_period=arguments.period))
    target = config.target()
    mount = pose(R_BC, np.array(config.chaser.camera_position))
    seen = [one for seed in range(arguments.seeds) for one in watch(config, seed, 120.0)]
    own = ModelFrontEnd()
    for name, has_prior, cut, edge, change in _VARIANTS:
        random, errors = np.random.default_rng(0), []
        registration = ModelRegistration(target, camera.geometry, mount, own.range_sigma, own.range_growth, cut)
        cleaning = Cleaning(camera.geometry, edge=edge)
        with change():
            for one in seen:
                cloud: Cloud = cleaning(one.frame, mount)
                offset = random.normal(size=6) * np.repeat([np.deg2rad(1.5), 0.015], 3) / np.sqrt(3.0)
                start = perturbed(one.T_MB, offset)
                found = registration(cloud, start, _INFORMATION if has_prior else None)
                errors.append(np.rad2deg(np.linalg.norm(difference(one.T_MB, found.pose)[:3])))
        print(
            f"{name:28} {len(errors)} frames  median {np.median(errors):.2f}  95th percentile "
            f"{np.percentile(errors, 95):.2f}  largest {max(errors):.1f} degrees",
            flush=True,
        )
    registration, cleaning = own.registration(target, camera.geometry, mount), Cleaning(camera.geometry, edge=np.inf)
    _print_half_turn(registration, cleaning, seen, mount)
    for name, _, _, _, change in _VARIANTS[:3]:
        with change():
            _print_errors_at_mating_point(name, registration, cleaning, target, mount)


if __name__ == "__main__":
    main()
