"""What the parts of the registration to a known shape are worth: single frames, from 1.5 degrees and 1.5 cm of error.

python benchmarks/rendezvous_registration.py [--profile nominal] [--seeds 3] [--period 3]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any
from unittest.mock import patch

import numpy as np

from safe_inspect.geometry.pointing import R_BC
from safe_inspect.rendezvous.front_end.cleaning import Cleaning, Cloud
from safe_inspect.rendezvous.front_end.model import registration as module
from safe_inspect.rendezvous.front_end.model.faces import Faces
from safe_inspect.rendezvous.front_end.model.kernel import Sums
from safe_inspect.rendezvous.front_end.model.registration import ModelRegistration, Prior
from safe_inspect.rendezvous.models import RendezvousConfig
from safe_inspect.rendezvous.plugins import TimeOfFlightCamera
from safe_inspect.rendezvous.poses import difference, perturbed, pose
from safe_inspect.rendezvous.recording.watch import WatchSensors, watch
from safe_inspect.types import FloatArray

_INFORMATION = np.diag(np.repeat([np.deg2rad(2.0), 0.02], 3) ** -2.0)


def _no_outline(*_: Any) -> Sums:
    return Sums(0.0, 0.0, 1, 0)


def _all_faces(self: Faces, _: FloatArray) -> Any:
    return np.ones(len(self.centre), np.bool_)


#: Name, prior or not, cut [m], edges of the depth image that are dropped [m], and what is patched.
_VARIANTS: tuple[tuple[str, bool, float, float, Callable[[], AbstractContextManager[Any]]], ...] = (
    ("as it is", True, 0.03, np.inf, nullcontext),
    ("no silhouette", True, 0.03, np.inf, lambda: patch.object(module, "add_silhouette_equations", _no_outline)),
    ("all faces, hidden ones too", True, 0.03, np.inf, lambda: patch.object(Faces, "looks_to", _all_faces)),
    ("no prior", False, 0.03, np.inf, nullcontext),
    ("cut 2 cm", True, 0.02, np.inf, nullcontext),
    ("cut 6 cm", True, 0.06, np.inf, nullcontext),
    ("no pixels beside a jump", True, 0.03, 0.03, nullcontext),
)


def main() -> None:
    """Print the errors of each variant."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--profile", choices=("clean", "nominal", "harsh"), default="nominal")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--period", type=float, default=3.0, help="time between two frames [s]")
    arguments = parser.parse_args()
    config = RendezvousConfig()
    camera, target = TimeOfFlightCamera(profile=arguments.profile), config.target()
    mount = pose(R_BC, np.array(config.chaser.camera_position))
    seen = [
        one
        for seed in range(arguments.seeds)
        for one in watch(config, WatchSensors(camera, period=arguments.period), seed, 120.0)
    ]
    for name, has_prior, cut, edge, change in _VARIANTS:
        random, errors = np.random.default_rng(0), []
        registration = ModelRegistration(target, camera.geometry, mount, cut=cut)
        cleaning = Cleaning(camera.geometry, edge=edge)
        with change():
            for one in seen:
                cloud: Cloud = cleaning(one.frame, mount)
                offset = random.normal(size=6) * np.repeat([np.deg2rad(1.5), 0.015], 3) / np.sqrt(3.0)
                start = perturbed(one.T_MB, offset)
                found = registration(cloud, start, Prior(start, _INFORMATION) if has_prior else None)
                errors.append(np.rad2deg(np.linalg.norm(difference(one.T_MB, found.pose)[:3])))
        print(
            f"{name:28} {len(errors)} frames  median {np.median(errors):.2f}  95th percentile "
            f"{np.percentile(errors, 95):.2f}  largest {max(errors):.1f} degrees",
            flush=True,
        )


if __name__ == "__main__":
    main()
