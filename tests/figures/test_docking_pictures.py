"""Films and pages of tasks without inspection points."""

from __future__ import annotations

import dataclasses
import json
import re

import numpy as np
import pytest

from safe_inspect.cli.main import main
from safe_inspect.config.data import configs_root
from safe_inspect.environments import load_spec
from safe_inspect.evaluation.results.files import read_trajectories, save_packed
from safe_inspect.evaluation.rollouts import record_episode
from safe_inspect.figures.film import Film, moment
from safe_inspect.figures.page import episode_page
from safe_inspect.policies import DockingAutopilot

DOCKING = str(configs_root() / "docking" / "experiment.yml")


def data_of(page):
    return json.loads(re.search(r'id="episode">(.*?)</script>', page, re.DOTALL).group(1))


@pytest.fixture(scope="module")
def docked():
    return record_episode(load_spec(DOCKING), DockingAutopilot(), seed=3)


@pytest.fixture(scope="module")
def docking_team():
    spec = load_spec(configs_root() / "multiagent-docking" / "experiment.yml")
    return record_episode(spec, DockingAutopilot(), seed=3).until(60.0)


def test_a_docking_is_filmed_and_viewed(tmp_path, capsys):
    source = ["DockingAutopilot", "--cfg", DOCKING, "--until", "20"]
    assert main(["film", *source, "--frames", "2", "--width", "320", "--output", str(tmp_path / "a.gif")]) == 0
    assert (tmp_path / "a.gif").read_bytes().startswith(b"GIF89a")
    assert main(["view", *source, "--output", str(tmp_path / "a.html")]) == 0
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "<title>DockingAutopilot, DOCKING, episode 0 of seed 0</title>" in page
    assert "points" not in capsys.readouterr().out


def test_the_docking_region_is_recorded_and_read_back(docked, tmp_path):
    assert docked.docking_radius == 0.5
    assert docked.range[-1, 0] <= 0.5
    save_packed(tmp_path / "trajectories.npz", (docked,))
    (again,) = read_trajectories(tmp_path)
    assert again.docking_radius == 0.5


def test_a_film_shows_speed_over_range_below_the_limit(docked):
    film = Film(docked, frames=3, width=320)
    assert (film.picture(0) != film.picture(2)).any()
    (line,), limit = film._side._lines, film._side._limit
    np.testing.assert_allclose(line.get_xdata(), docked.range[:, 0])
    np.testing.assert_allclose(line.get_ydata(), docked.speed[:, 0])
    assert (line.get_ydata() <= limit[:, 0]).all()
    assert film._counters[1].get_text() == f"{docked.range[-1, 0]:.1f} m"


def test_a_team_is_filmed(docking_team):
    film = Film(docking_team, frames=2, width=320, turn=30.0)
    assert film.picture(1).shape == (200, 320, 3)
    assert len(film._side._lines) == 3


def test_a_moment_without_a_sun_has_no_light(docked):
    now = moment(docked, 10.5)
    assert now.sun is None
    assert not now.lit.any()
    low, high = sorted((docked.range[10, 0], docked.range[11, 0]))
    assert low < np.linalg.norm(now.position[0]) < high


def test_the_page_of_a_docking(docked, docking_team):
    data = data_of(episode_page(docked))
    assert [chart["label"].split()[0].rstrip(",;") for chart in data["charts"]] == [
        "range",
        "speed",
        "thrust",
        "delta-v",
    ]
    speed, limit = (line["values"] for line in data["charts"][1]["lines"])
    np.testing.assert_allclose(speed, docked.speed[:, 0], atol=6e-5)
    np.testing.assert_allclose(limit, docked.speed_limit[:, 0], atol=6e-5)
    assert data["sun"] is None
    assert data["points"] == []
    assert data["docking_radius"] == data["radius"] == 0.5
    assert data["ending"] == "success"
    assert len(data_of(episode_page(docking_team))["charts"][1]["lines"]) == 6


def test_a_page_without_an_orbit_shows_no_limit(docked):
    plain = dataclasses.replace(docked, mean_motion=0.0, docking_radius=0.0, arrays={})
    speed = data_of(episode_page(plain))["charts"][1]
    assert speed["label"] == "speed [m/s]"
    assert len(speed["lines"]) == 1
    assert Film(plain, frames=2, width=320).picture(1).any()
