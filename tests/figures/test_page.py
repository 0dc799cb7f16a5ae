from __future__ import annotations

import dataclasses
import json
import re

import numpy as np
import pytest

from safe_inspect.environments import load_spec
from safe_inspect.errors import OutputError
from safe_inspect.evaluation.policies import with_scripted
from safe_inspect.evaluation.rollouts import rollout
from safe_inspect.figures.drawing import speed_limit_of
from safe_inspect.figures.film import moment
from safe_inspect.figures.page import episode_page, save_page
from safe_inspect.policies import RandomThrust


def data_of(page):
    found = re.search(r'<script type="application/json" id="episode">(.*?)</script>', page, re.DOTALL)
    return json.loads(found.group(1))


@pytest.fixture(scope="module")
def page(flown_team):
    return episode_page(flown_team, "Three & <more>")


def test_the_page_needs_nothing_from_outside(page):
    assert "://" not in page
    assert not re.search(
        r"\b(src|href|action|data|poster|srcset)\s*=", re.sub(r"<script.*?</script>", "", page, flags=re.S)
    )
    for word in ("@import", "url(", "import(", "fetch(", "XMLHttpRequest", "WebSocket", "<link", "<iframe", "<img"):
        assert word not in page
    assert "@DATA@" not in page
    assert "@SCRIPT@" not in page


def test_the_page_is_small(page):
    assert len(page.encode()) < 400_000


def test_the_title_is_text(page):
    assert "<title>Three &amp; &lt;more&gt;</title>" in page


def test_the_page_holds_the_episode(page, flown_team):
    data = data_of(page)
    np.testing.assert_allclose(data["time"], flown_team.time)
    np.testing.assert_allclose(np.array(data["position"]).transpose(1, 0, 2), flown_team.position, atol=6e-4)
    np.testing.assert_allclose(np.array(data["delta_v"]).T, flown_team.delta_v, atol=6e-6)
    np.testing.assert_allclose(data["points"], flown_team.points, atol=6e-4)
    when = [np.inf if value is None else value for value in data["inspected_at"]]
    np.testing.assert_allclose(when, flown_team.inspected_at)
    assert data["inspector"] == flown_team.inspector.tolist()
    assert [deputy["name"] for deputy in data["deputies"]] == list(flown_team.deputies)
    assert len({deputy["colour"] for deputy in data["deputies"]}) == 3


def test_the_charts_have_a_value_for_every_state(page, flown_team):
    charts = data_of(page)["charts"]
    assert [chart["label"].split()[0].rstrip(",;") for chart in charts] == [
        "inspected",
        "range",
        "speed",
        "norm",
        "delta-v",
    ]
    for chart in charts:
        low, high = chart["range"]
        assert low < high
        assert all(len(line["values"]) == len(flown_team.time) for line in chart["lines"])
    np.testing.assert_allclose(charts[0]["lines"][0]["values"], 100.0 * flown_team.coverage)


def test_speed_above_the_safe_one_is_marked(flown):
    limit = speed_limit_of(flown)
    above = flown.speed > limit
    assert above.any()
    (speed,) = (item for item in data_of(episode_page(flown))["charts"] if item["label"].startswith("speed"))
    assert speed["label"] == "speed; dashed: the largest safe one; black: above it [m/s]"
    marked = np.array([value is not None for value in speed["lines"][-1]["values"]])
    np.testing.assert_array_equal(marked[1:], (above[1:] | above[:-1])[:, 0])
    calm = dataclasses.replace(flown, velocity=np.zeros_like(flown.velocity))
    (speed,) = (item for item in data_of(episode_page(calm))["charts"] if item["label"].startswith("speed"))
    assert speed["label"] == "speed; dashed: the largest safe one [m/s]"
    assert len(speed["lines"]) == 2


def test_a_single_deputy_has_the_thrust_of_each_axis(flown):
    chart = next(chart for chart in data_of(episode_page(flown))["charts"] if chart["label"].startswith("thrust"))
    drawn = np.array([line["values"][:-1] for line in chart["lines"]]).T
    np.testing.assert_allclose(drawn, flown.control[:, 0], atol=6e-5)


def test_the_burns_point_along_the_thrust(flown):
    (burns,) = data_of(episode_page(flown))["burns"]
    assert [burn["step"] for burn in burns] == np.flatnonzero(np.abs(flown.control[:, 0]).sum(axis=-1)).tolist()
    for burn in burns:
        thrust = flown.control[burn["step"], 0]
        cosine = np.dot(burn["thrust"], thrust) / np.linalg.norm(burn["thrust"]) / np.linalg.norm(thrust)
        assert cosine == pytest.approx(1.0, abs=1e-4)


def test_a_name_cannot_end_the_script(flown):
    evil = dataclasses.replace(flown, deputies=("</script><script>alert(1)",))
    page = episode_page(evil)
    assert page.count("</script>") == episode_page(flown).count("</script>")
    assert data_of(page)["deputies"][0]["name"] == "</script><script>alert(1)"


def test_a_page_that_cannot_be_written_is_one_message(page, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="the file cannot be written"):
        save_page(page, tmp_path / "file" / "a.html")
    with pytest.raises(OutputError, match=r"must end in \.html"):
        save_page(page, tmp_path / "a.pdf")
    save_page(page, tmp_path / "new" / "a.html")
    assert (tmp_path / "new" / "a.html").read_text(encoding="utf-8") == page


def test_a_deputy_that_turns_has_its_attitude_and_its_camera():
    spec = load_spec("safe_inspect/MultiagentWeightedSixDofInspection-v0", ["horizon=5"])
    flown = rollout(with_scripted(spec, RandomThrust()), {}, episodes=1, seed=0, record=1).trajectories[0]
    data = data_of(episode_page(flown))
    np.testing.assert_allclose(np.array(data["orientation"]).transpose(1, 0, 2), flown.orientation, atol=6e-6)
    assert data["cone"] == {"axis": [1, 0, 0], "half": pytest.approx(np.radians(30.0))}
    assert data["chief"] is None


def test_the_points_of_a_chief_that_turns_turn(flown):
    angle = 1e-3 * flown.time
    attitude = np.stack([0 * angle, 0 * angle, np.sin(angle / 2), np.cos(angle / 2)], axis=-1)
    turning = dataclasses.replace(flown, arrays={**flown.arrays, "chief_orientation": attitude})
    np.testing.assert_allclose(data_of(episode_page(turning))["chief"], attitude, atol=6e-6)
    half = 0.5 * (flown.time[2] + flown.time[3])
    c, s = np.cos(1e-3 * half), np.sin(1e-3 * half)
    expected = flown.points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    now = moment(turning, half)
    np.testing.assert_allclose(now.points, expected, atol=1e-7)
    np.testing.assert_array_equal(now.lit, expected @ now.sun > 0.0)


def test_the_page_is_made_for_phones_and_for_both_schemes(page):
    assert '<meta name="viewport" content="width=device-width, initial-scale=1">' in page
    assert "@media (prefers-color-scheme: dark)" in page
    assert "@media (max-width: 760px)" in page
