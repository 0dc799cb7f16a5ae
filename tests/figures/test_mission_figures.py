from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from safe_inspect.dynamics.quaternion import exp, multiply, rotate, to_matrix
from safe_inspect.figures.mission_figure import _plan_clearance, outcome_of, tracking_error
from safe_inspect.figures.mission_film import MissionFilm
from safe_inspect.figures.mission_page import mission_data, mission_page
from safe_inspect.figures.mission_scene import DrawnSolid, best_view, ribbon
from safe_inspect.geometry.oriented_boxes import OrientedBoxes
from safe_inspect.geometry.picture import Camera
from safe_inspect.missions.record import MissionRecord
from safe_inspect.rendezvous.coordination.context import Phase
from safe_inspect.rendezvous.target.boxes import mesh_of_boxes
from safe_inspect.rendezvous.target.surface import MeshSurface

FIRST, STEPS = 15, 40  # the first step of the approach, and the number of steps


def test_a_record_has_phases_plans_and_the_distance_to_the_mating_point(record: MissionRecord) -> None:
    assert [phase.phase for phase in record.phases()] == [Phase.OBSERVE, Phase.TRACK]
    np.testing.assert_allclose([time for phase in record.phases() for time in phase[1:]], [0.0, 3.0, 3.0, 8.0])
    assert record.approach() == FIRST
    assert record.mating_distance()[-1] == pytest.approx(0.0, abs=1e-12)
    assert len(record.plans) == 1
    np.testing.assert_allclose(record.plans[0].position, record.arrays["x"][FIRST:, :3])
    short = record.until(2.0)
    assert short.plans == ()
    assert len(short.arrays["t"]) == 11
    assert outcome_of(short).startswith("OBSERVE at 2 s; ")
    assert outcome_of(record).startswith("success after 8 s; least clearance 22.0 cm, ")


def test_the_clearance_of_a_plan_is_that_of_the_boxes(record: MissionRecord) -> None:
    plan = record.plans[0]
    in_model = plan.position_target @ record.target.R_MT.T
    expected = record.target.solid.distance(in_model) - record.config.chaser.radius
    np.testing.assert_allclose(_plan_clearance(record, plan), expected, atol=1e-12)


def test_the_error_is_from_the_true_reference_where_one_is_followed(record: MissionRecord) -> None:
    error = tracking_error(record.arrays)
    assert np.isnan(error[:FIRST]).all()
    np.testing.assert_allclose(error[FIRST:], -0.01, atol=1e-12)


def _drawn(boxes: OrientedBoxes, cell: float) -> DrawnSolid:
    return DrawnSolid.of(MeshSurface(mesh_of_boxes(boxes)), np.eye(3), cell)


def test_boxes_hide_what_is_behind_them() -> None:
    angle = np.deg2rad(30.0)
    turned = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    boxes = OrientedBoxes(np.array([[0.2, 0.0, 0.1]]), np.array([[0.5, 0.2, 0.1]]), turned[None])
    solid = _drawn(boxes, 0.1)
    view = Camera.at(20.0, 40.0)
    rng = np.random.default_rng(0)
    points = rng.uniform(-1.5, 1.5, (400, 3))
    # A point is hidden where a step towards the reader is inside the box.
    along = points[:, None, :] + np.linspace(0.0, 6.0, 6001)[None, :, None] * view.sight
    inside = boxes.distance(along.reshape(-1, 3)).reshape(400, -1).min(axis=1)
    clear = np.abs(inside) > 5e-3
    np.testing.assert_array_equal(solid.hides(points, view.sight)[clear], (inside < 0.0)[clear])
    assert 0 < (inside < 0.0).sum() < 200


def test_the_patches_cover_the_boxes_and_those_in_front_come_last() -> None:
    boxes = OrientedBoxes(np.zeros((1, 3)), np.array([[0.5, 0.2, 0.1]]), np.eye(3)[None])
    solid = _drawn(boxes, 0.15)
    sides = solid.patches[:, 1] - solid.patches[:, 0], solid.patches[:, 2] - solid.patches[:, 0]
    assert 0.5 * np.linalg.norm(np.cross(*sides), axis=1).sum() == pytest.approx(2 * (0.4 + 0.2 + 0.08))
    np.testing.assert_allclose(np.abs(boxes.distance(solid.patches.reshape(-1, 3))), 0.0, atol=1e-12)
    corners, brightness = solid.seen_patches(Camera.at(90.0 - 1e-9, 0.0))
    assert len(corners) == (solid.normals[:, 2] > 0.5).sum()
    assert (brightness <= 1.0).all()
    # Nine of twelve edges of a box are seen from a corner.
    seen = solid.seen_edges(Camera.at(35.0, 40.0))
    hidden = solid.hides(solid.edges.mean(axis=1), Camera.at(35.0, 40.0).sight)
    lengths = np.linalg.norm(solid.edges[:, 1] - solid.edges[:, 0], axis=1)
    assert len(seen) == (~hidden).sum()
    assert lengths[hidden].sum() == pytest.approx(1.0 + 0.4 + 0.2)


def test_the_tube_is_as_wide_as_its_box() -> None:
    path = np.linspace([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], 11)
    above = Camera(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    outline = ribbon(path, np.full(11, 0.05), above)
    np.testing.assert_allclose(np.abs(outline[:, 1]), 0.05)
    c = np.sqrt(0.5)
    turned = np.broadcast_to([[c, -c, 0.0], [c, c, 0.0], [0.0, 0.0, 1.0]], (11, 3, 3))
    np.testing.assert_allclose(np.abs(ribbon(path, np.full(11, 0.05), above, turned)[:, 1]), 0.05 * np.sqrt(2.0))


def test_the_view_shows_a_path_next_to_what_would_hide_it() -> None:
    solid = _drawn(OrientedBoxes(np.zeros((1, 3)), np.array([[1.0, 1.0, 2.0]]), np.eye(3)[None]), 0.5)
    path = np.linspace([3.0, 0.0, 0.0], [1.5, 0.0, 0.0], 20)
    view = best_view(path, solid, np.eye(3))
    assert not solid.hides(path, view.sight).any()
    assert np.linalg.norm(view.flat(path[-1])) > 1.3


def test_the_page_holds_the_mission_and_needs_nothing_from_outside(record: MissionRecord) -> None:
    data = mission_data(record)
    np.testing.assert_allclose(data["position"], record.arrays["x"][:, :3], atol=6e-5)
    np.testing.assert_allclose(data["attitude"], record.arrays["target_q"], atol=6e-6)
    assert data["tube"][:FIRST] == [None] * FIRST
    assert data["tube"][FIRST:] == [0.05] * (STEPS - FIRST)
    assert [band["name"] for band in data["bands"]] == ["OBSERVE", "TRACK"]
    assert len(data["charts"]) == 4
    for chart in data["charts"]:
        assert all(len(line["values"]) == STEPS for line in chart["lines"])
        assert chart["range"][0] < chart["range"][1]
    page = mission_page(record, "One & <two>")
    assert "<title>One &amp; &lt;two&gt;</title>" in page
    for word in ("://", "@DATA@", "@SCRIPT@", "import(", "fetch(", "XMLHttpRequest", "<link", "<img"):
        assert word not in page
    assert len(page.encode()) < 400_000


def test_a_film_moves_and_ends_at_the_mating_point(record: MissionRecord) -> None:
    film = MissionFilm(record, frames=3, width=320)
    pictures = list(film)
    assert [picture.shape for picture in pictures] == [(200, 320, 3)] * 3
    assert film.size == (320, 200)
    assert (pictures[0] != pictures[-1]).any()
    with pytest.raises(ValueError, match="at least 2 frames"):
        MissionFilm(record, frames=1)


def test_a_film_shows_where_the_chaser_believes_the_target(record: MissionRecord) -> None:
    """The chaser is in error by an attitude, in its frame W too, and by a distance."""
    arrays, steps = dict(record.arrays), np.arange(STEPS)
    turn_of_world, error, shift = (
        exp(np.array([0.2, 0.1, -0.3])),
        exp(np.array([0.0, 0.0, 0.1])),
        np.array([0.02, 0.0, 0.0]),
    )
    arrays["estimated_q"] = multiply(turn_of_world, arrays["q"])
    arrays["estimated_target_q"] = multiply(multiply(turn_of_world, arrays["target_q"]), error)
    arrays["estimated_target_p"] = rotate(turn_of_world, rotate(arrays["target_q"], shift))
    arrays["estimated_x"] = np.concatenate((rotate(turn_of_world, arrays["x"][:, :3]), arrays["x"][:, 3:]), axis=1)
    arrays["sigma"] = np.where(steps[:, None] < 5, np.pi, 0.01) * np.ones(2)
    uncertain = replace(record, arrays=arrays)
    assert record.believed_target(20) is None
    assert uncertain.believed_target(4) is None  # not known yet
    rotation, offset = uncertain.believed_target(20) or (None, None)
    np.testing.assert_allclose(rotation, to_matrix(error), atol=1e-12)
    np.testing.assert_allclose(offset, shift, atol=1e-12)
    exact, film = MissionFilm(record, frames=2, width=320), MissionFilm(uncertain, frames=2, width=320)
    assert (exact.picture(1) != film.picture(1)).any()
    assert film._off.get_text().endswith("off by 5.7 deg and 20 mm")
    assert not exact._off.get_text()


def test_the_data_of_a_page_are_plain(record: MissionRecord) -> None:
    json.dumps(mission_data(record), allow_nan=False)
