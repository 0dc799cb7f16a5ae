"""Alignment of observed views to the known model: which of four attitudes, and how well.

python benchmarks/rendezvous_alignment.py [--profile nominal] [--seeds 8] [--trials 5]

Each trial takes 12 of the frames of a watch with their true relative poses, axes that are wrong by about 3 degrees and
have random signs, and a centre of mass that is wrong by about 3 cm.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from safe_inspect.geometry.pointing import R_BC
from safe_inspect.rendezvous.characterise.polhode import HALF_TURNS
from safe_inspect.rendezvous.front_end.cleaning import Cleaning
from safe_inspect.rendezvous.front_end.model.alignment import ObservedView, align, axis_candidates
from safe_inspect.rendezvous.front_end.model.registration import ModelRegistration
from safe_inspect.rendezvous.models import RendezvousConfig, SensorsConfig
from safe_inspect.rendezvous.plugins import TimeOfFlightCamera
from safe_inspect.rendezvous.poses import inverse, pose, rotation_exp, rotation_log
from safe_inspect.rendezvous.recording.watch import watch

_VIEWS, _POINTS = 12, 400


def main() -> None:
    """Print each trial and the sums."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--profile", choices=("clean", "nominal", "harsh"), default="nominal")
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--trials", type=int, default=5)
    arguments = parser.parse_args()
    camera = TimeOfFlightCamera(profile=arguments.profile)
    config = RendezvousConfig(sensors=SensorsConfig(camera=camera, frame_period=4.0))
    target = config.target()
    mount = pose(R_BC, np.array(config.chaser.camera_position))
    registration = ModelRegistration(target, camera.geometry, mount)
    cleaning = Cleaning(camera.geometry, edge=np.inf)
    rows = []
    for seed in range(arguments.seeds):
        random = np.random.default_rng(seed)
        seen = list(watch(config, seed, 120.0))
        glued = inverse(seen[0].T_MB)
        clouds = [cleaning(one.frame, mount).thinned(_POINTS) for one in seen]
        for _ in range(arguments.trials):
            chosen = random.choice(len(seen), _VIEWS, replace=False)
            views = [ObservedView(clouds[k], glued @ seen[k].T_MB) for k in chosen]
            wrong = rotation_exp(np.deg2rad(3.0) * random.normal(size=3) / np.sqrt(3.0))
            axes = glued[:3, :3] @ target.R_MT @ wrong @ HALF_TURNS[random.integers(4)]
            centre = glued[:3, 3] + 0.03 * random.normal(size=3) / np.sqrt(3.0)
            begin = time.process_time()
            found = align(registration, views, axis_candidates(target, axes, centre))
            angle = np.rad2deg(np.linalg.norm(rotation_log(glued[:3, :3].T @ found.T_GM[:3, :3])))
            distance = 1e3 * np.linalg.norm(found.T_GM[:3, 3] - glued[:3, 3])
            rows.append((angle, distance, found.margin))
            print(
                f"{seed} {angle:7.2f} degrees {distance:5.1f} mm, second score {found.margin:.2f} times the best, "
                f"{time.process_time() - begin:.2f} s",
                flush=True,
            )
    angles, distances, margins = np.array(rows).T
    right = angles < 10.0
    print(
        f"right {right.sum()} of {len(right)}; median {np.median(angles[right]):.2f}, largest "
        f"{angles[right].max():.2f} degrees; median {np.median(distances[right]):.1f}, largest "
        f"{distances[right].max():.1f} mm; least lead {margins.min():.2f}"
    )


if __name__ == "__main__":
    main()
