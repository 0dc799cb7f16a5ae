from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from safe_inspect.evaluation import rollout

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def flown(spec):
    sys.path.insert(0, str(EXAMPLES))
    try:
        from scripted_pilot import ScriptedPilot
    finally:
        sys.path.remove(str(EXAMPLES))
    return rollout(spec, ScriptedPilot(), episodes=12, seed=3, record=12)


def test_the_pilot_inspects_every_point_with_three_burns(flown):
    assert flown.success.all()
    for one in flown.trajectories:
        burns = np.flatnonzero(np.abs(one.control[:, 0]).max(axis=1))
        assert len(burns) <= 3
        assert one.range.min() > 12.0
    assert flown.delta_v.mean() < 0.6


def test_the_pilot_follows_the_sun_on_a_closed_ellipse(flown):
    n = 0.001027
    for one in flown.trajectories:
        burns = np.flatnonzero(np.abs(one.control[:, 0, :2]).max(axis=1))
        after = burns[-1] + 1
        x, y, _ = one.position[after:, 0].T
        v_x, v_y, _ = one.velocity[after:, 0].T
        np.testing.assert_allclose(v_y, -2.0 * n * x, atol=2e-6)
        np.testing.assert_allclose(v_x, n * y / 2.0, atol=2e-6)
        off = np.angle(np.exp(1j * (np.arctan2(-y / 2.0, x) - one.sun_angle[after:])))
        assert np.abs(off).max() < 0.2


def test_the_picture_of_the_readme_can_be_drawn_again(tmp_path):
    command = [sys.executable, str(EXAMPLES / "draw_trajectory.py"), "--seed", "4", "--until", "5200"]
    done = subprocess.run([*command, "--out", str(tmp_path / "a.png")], capture_output=True, text=True, check=True)
    assert "success rate 100.0 %" in done.stdout
    assert 20_000 < (tmp_path / "a.png").stat().st_size < 250_000


def test_a_picture_that_cannot_be_written_is_one_message(tmp_path):
    (tmp_path / "file").write_text("")
    command = [sys.executable, str(EXAMPLES / "draw_trajectory.py"), "--out", str(tmp_path / "file" / "a.png")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("cannot write the figure")
    assert "Traceback" not in done.stderr
