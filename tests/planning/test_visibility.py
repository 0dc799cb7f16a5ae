"""From where a whole sphere is in a camera's view, and when a point is lit for every viewer."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from safe_inspect.geometry.light import binary_light, phong_light
from safe_inspect.geometry.sphere import sphere_points
from safe_inspect.planning.visibility import lit_from_all_sides, sight_range
from safe_inspect.tasks.inspection.points_view import PointsModel


@given(radius=st.floats(0.1, 100.0), field_of_view=st.floats(0.05, 3.1))
def test_the_cone_touches_the_sphere_from_the_range_of_sight(radius: float, field_of_view: float) -> None:
    distance = sight_range(radius, field_of_view)
    assert np.arcsin(radius / distance) == pytest.approx(0.5 * field_of_view, rel=1e-9)


@pytest.mark.parametrize("field_of_view", [np.pi, 4.0, 2.0 * np.pi])
def test_a_camera_that_sees_half_of_space_may_be_at_the_surface(field_of_view: float) -> None:
    assert sight_range(3.0, field_of_view) == 3.0


def test_a_point_counts_as_lit_where_it_is_from_above_and_from_below() -> None:
    points = sphere_points("fibonacci", 60, 10.0)
    angle = np.linspace(0.0, 2.0 * np.pi, 24)
    sun = np.stack((np.cos(angle), np.sin(angle), 0.0 * angle), axis=1)
    plain = PointsModel("chief", 1, points, 10.0, binary_light(10.0))
    np.testing.assert_array_equal(lit_from_all_sides(plain, sun), sun @ points.T > 0.0)
    shiny = PointsModel("chief", 1, points, 10.0, phong_light(10.0, shininess=4.0))
    found = lit_from_all_sides(shiny, sun)
    sides = [shiny.lit(np.tile((0.0, 0.0, z), (24, 1)), sun) for z in (1e6, -1e6)]
    np.testing.assert_array_equal(found, sides[0] & sides[1])
    assert (found != sides[0]).any()
    assert (found != sides[1]).any()
