from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from safe_inspect.platforms.controllers import RateController
from safe_inspect.platforms.cwh import CWHPlatform
from safe_inspect.plugins.functor import build, errors_of


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_command_is_thrust_along_one_axis(axis):
    thrust = RateController(axis=axis)(np.array([[0.25], [-1.0], [0.0]]))
    expected = np.zeros((3, 3))
    expected[:, axis] = [0.25, -1.0, 0.0]
    np.testing.assert_array_equal(thrust, expected)


def test_a_command_is_clipped_to_the_propertys_limits():
    controller = RateController(axis=1, properties={"name": "y_thrust", "low": -0.5, "high": 2.0})
    np.testing.assert_array_equal(controller(np.array([[3.0], [-3.0], [1.5]]))[:, 1], [2.0, -0.5, 1.5])
    np.testing.assert_array_equal(controller.limits, [[-0.5], [2.0]])


@pytest.mark.parametrize(
    "properties",
    [{"low": -200, "high": 500, "units": "mN"}, {"low": "-200 mN", "high": "0.5 N"}, {"low": -0.2, "high": 0.5}],
)
def test_limits_take_units(properties):
    np.testing.assert_allclose(np.ravel(RateController(properties=properties).limits), [-0.2, 0.5])


@pytest.mark.parametrize(
    ("config", "words"),
    [
        ({"axis": 3}, "takes a MomentProp"),
        ({"property_class": "ThurstProp"}, "did you mean `ThrustProp`"),
        ({"properties": {"low": 1.0, "high": 1.0}}, "not below"),
        ({"properties": {"units": "m"}}, "not a unit of force"),
        ({"properties": {"low": "-200 mN", "units": "mN"}}, "in addition to `units`"),
        ({"properties": {"hihg": 2.0}}, "hihg"),
    ],
)
def test_what_a_controller_cannot_be(config, words):
    with pytest.raises(ValidationError) as caught:
        RateController.model_validate(config)
    (error,) = errors_of(caught.value)
    assert words in f"{error['loc']} {error['msg']}"


def test_the_property_of_safe_autonomy_sims_is_known():
    name = "safe_autonomy_sims.platforms.cwh.cwh_properties.ThrustProp"
    assert RateController(property_class=name).limits[1] == 1.0


def test_a_part_may_be_named_next_to_its_config():
    part = build("part", {"part": "RateController", "name": "X Thrust", "config": {"axis": 0}})
    assert part.part_name == "X Thrust"
    assert build("part", {"part": "RateController"}).part_name == "RateController"


@pytest.mark.parametrize("mass", [0.0, -12.0, "12 m"])
def test_a_platform_has_a_mass(mass):
    with pytest.raises(ValidationError):
        CWHPlatform(mass=mass)


def test_mass_takes_units():
    assert CWHPlatform(mass="12000 g").mass == pytest.approx(12.0)
