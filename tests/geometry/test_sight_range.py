"""From where a whole sphere is in a camera's view."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from safe_inspect.geometry.visibility import sight_range


@given(radius=st.floats(0.1, 100.0), field_of_view=st.floats(0.05, 3.1))
def test_the_cone_touches_the_sphere_from_the_range_of_sight(radius: float, field_of_view: float) -> None:
    distance = sight_range(radius, field_of_view)
    assert np.arcsin(radius / distance) == pytest.approx(0.5 * field_of_view, rel=1e-9)


@pytest.mark.parametrize("field_of_view", [np.pi, 4.0, 2.0 * np.pi])
def test_a_camera_that_sees_half_of_space_may_be_at_the_surface(field_of_view: float) -> None:
    assert sight_range(3.0, field_of_view) == 3.0
