import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from safe_inspect.dynamics.quaternion import normalise
from safe_inspect.geometry.oriented_boxes import OrientedBoxes
from safe_inspect.rendezvous.planner.query import PlanQuery

sys.path.append(str(Path(__file__).parents[3] / "benchmarks"))  # SciPy's optimiser, which the benchmark has too


@pytest.fixture(scope="session")
def query():
    """Return a function of a seed: an approach to a bus with one long array, which tumbles at 5 deg/s."""
    base = PlanQuery(
        t0=100.0,
        state=np.array([0.0, -1.5, 0.0, 0.0, 0.0, 0.0]),
        orientation=np.array([0.0, 0.0, 0.0, 1.0]),
        angular_velocity=np.deg2rad(5.0) * np.array([0.7, 0.5, 0.5]) / np.linalg.norm([0.7, 0.5, 0.5]),
        inertia=np.array([0.1314, 0.9661, 1.0]),
        mating_point=np.array([0.25, 0.0, 0.42]),
        solid=OrientedBoxes(
            np.array([[-0.057, 0.0, 0.0], [0.645, 0.0, 0.0]]),
            np.array([[0.25, 0.069, 0.053], [0.35, 0.125, 0.003]]),
            np.stack((np.eye(3), np.eye(3))),
        ),
        R_MT=np.eye(3),
    )

    def make(seed=0, **changes):
        orientation = normalise(np.random.default_rng(seed).normal(size=4))
        return replace(base, orientation=orientation, **changes)

    return make
