"""What the filter that holds certifies, against closed forms: speeds of closed motions, and the reach of its plans."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.rta.backup.closed_motion import NODE_STACK, closed_motion
from safe_inspect.rta.backup.safety_filter import BackupFilter
from safe_inspect.rta.backup.sequences import SAFE
from safe_inspect.rta.constraints import RelativeState
from safe_inspect.rta.constraints.rows import Margins

N, LIMIT = 0.001027, 0.05


@pytest.mark.parametrize("name", ["x_vel", "y_vel", "z_vel"])
@pytest.mark.parametrize("phase", [0.0, 1.0, 2.5])
def test_a_closed_motion_is_as_fast_as_its_amplitudes_say(name, phase):
    """Of amplitudes A in x and B in z the largest speeds are n A, 2 n A and n B, whatever the phase."""
    run = BackupFilter({"n": N, "vel_limit": LIMIT}, [name])
    work, weak = np.empty(NODE_STACK), np.zeros(2, np.int64)
    kept = []
    sizes = np.linspace(5.0, 80.0, 151)
    for size in sizes:
        a, b = (0.0, size) if name == "z_vel" else (size, 0.0)
        x, u, z, w = a * np.cos(phase), -a * np.sin(phase), b * np.cos(phase), -b * np.sin(phase)
        state = (x, 300.0, z, N * u, -2.0 * N * x, N * w)
        code = closed_motion(run._model, tuple(map(float, state)), (1.0, 0.0), Margins(0.0, 0.0, 0.0), work, weak)
        kept.append(code == SAFE)
    fastest = {"x_vel": 1.0, "y_vel": 2.0, "z_vel": 1.0}[name] * N * sizes
    np.testing.assert_array_equal(kept, fastest <= LIMIT)


@pytest.mark.parametrize(("mass", "holds"), [(60.0, 8), (30.0, 4), (24.0, 4)])
def test_a_plan_of_several_holds_reaches_as_far_as_their_thrusts(mass, holds):
    """It stops a drift of at most one hold's change of the velocity times the holds that together reach 0.8 m/s."""
    change = 0.6 * 10.0 / mass
    assert holds == np.ceil(0.8 / change)
    speeds = np.arange(0.0, 1.2, 0.01)
    velocity = np.zeros((len(speeds), 3))
    velocity[:, 1] = speeds
    state = RelativeState(np.tile([0.0, 500.0, 0.0], (len(speeds), 1)), velocity, np.zeros(len(speeds)))
    for several, most in ((False, 1), (True, holds)):
        run = BackupFilter({"m": mass, "u_max": 0.6}, ["chief_collision"], several_holds=several)
        found = run.recoverable(state)
        assert speeds[found].max() == pytest.approx(most * change, abs=0.015)
        assert found[: found.sum()].all()
