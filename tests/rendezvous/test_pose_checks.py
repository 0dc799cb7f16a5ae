"""Quaternions of a file are those of rotations, up to their written digits."""

from __future__ import annotations

import pytest

from safe_inspect.missions.sensor_log import StartDescription


@pytest.mark.parametrize("length", [0.9991, 1.0, 1.0009])
def test_a_quaternion_of_four_digits_is_taken(length: float) -> None:
    StartDescription(orientation=(0.0, 0.6 * length, 0.0, 0.8 * length))


@pytest.mark.parametrize("length", [0.0, 0.9988, 1.0012, 2.0])
def test_what_is_no_rotation_is_refused(length: float) -> None:
    with pytest.raises(ValueError, match=r"orientation is not a unit quaternion \[x, y, z, w\]: its length is "):
        StartDescription(orientation=(0.0, 0.6 * length, 0.0, 0.8 * length))
