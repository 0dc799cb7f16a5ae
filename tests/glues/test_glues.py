from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments import BatchedEnvironment
from safe_inspect.glues.actions import ControllerGlue
from safe_inspect.glues.normalizers import Normalization
from safe_inspect.glues.observations import ObserveSensor
from safe_inspect.platforms.controllers import RateController
from safe_inspect.platforms.point_sensors import UninspectedPointsSensor
from safe_inspect.platforms.state_sensors import PositionSensor, SunAngleSensor

PARTS = {part.part_name: part for part in (PositionSensor(), SunAngleSensor(), UninspectedPointsSensor())}
GLUES = "agent_config.0.config.config.glues"


@pytest.fixture
def observe(fixed_start: Callable[..., EnvironmentSpec]) -> Callable[[str, int], np.ndarray]:
    """Return a function: the first observation of one element with a glue of one's own."""

    def observation(config: str) -> np.ndarray:
        spec = fixed_start((60.0, -30.0, 0.0), sun_angle=1.0,
                           overrides=[f"{GLUES}.5={{functor: ObserveSensor, config: {config}}}"])  # fmt: skip
        return BatchedEnvironment(spec).reset()[0, 0, 10:]

    return observation


def test_readings_in_units(observe):
    np.testing.assert_allclose(observe("{sensor: Sensor_Position, output_units: km}"), [0.06, -0.03, 0.0])
    np.testing.assert_allclose(
        observe("{sensor: Sensor_SunAngle, output_units: degrees}"), [180.0 / math.pi], rtol=1e-6
    )


def test_units_come_before_the_normalisation(observe):
    scaled = "{normalizer: StandardNormalNormalizer, config: {mu: 0.01, sigma: 0.1}}"
    found = observe(f"{{sensor: Sensor_Position, output_units: km, normalization: {scaled}}}")
    np.testing.assert_allclose(found, [0.5, -0.4, -0.1], rtol=1e-6)


def test_an_angle_is_mapped_onto_an_interval(observe):
    found = observe("{sensor: Sensor_SunAngle, normalization: {normalizer: LinearNormalizer}}")
    np.testing.assert_allclose(found, [1.0 / math.pi - 1.0], rtol=1e-6)


def test_an_observation_can_be_kept_from_the_policy(fixed_start):
    """The sensor is read all the same: the filter and the rewards may need it."""
    hidden = "{functor: ObserveSensor, config: {sensor: Sensor_InspectedPoints, training_export_behavior: EXCLUDE}}"
    whole, part = (
        BatchedEnvironment(fixed_start((60.0, -30.0, 0.0), overrides=overrides))
        for overrides in ([], [f"{GLUES}.3={hidden}"])
    )
    names = whole.observation_layout.names
    kept = [index for index, name in enumerate(names) if not name.startswith("Sensor_InspectedPoints")]
    assert part.observation_layout.names == tuple(names[index] for index in kept)
    np.testing.assert_array_equal(part.reset()[..., :], whole.reset()[..., kept])
    action = np.zeros((1, 1, 3))
    np.testing.assert_array_equal(part.step(action).observation, whole.step(action).observation[..., kept])


def test_bounds_of_observations():
    degrees = ObserveSensor(sensor="Sensor_SunAngle", output_units="deg")
    np.testing.assert_allclose(np.ravel(degrees.bounds(PARTS)), [0.0, 360.0])
    linear = ObserveSensor(sensor="Sensor_SunAngle", normalization=Normalization())
    np.testing.assert_allclose(np.ravel(linear.bounds(PARTS)), [-1.0, 1.0])
    np.testing.assert_array_equal(ObserveSensor().bounds(PARTS), [[-np.inf] * 3, [np.inf] * 3])
    direction = ObserveSensor(
        sensor="Sensor_UninspectedPoints", output_units="m"
    )  # as in the files of safe-autonomy-sims
    np.testing.assert_array_equal(direction.bounds(PARTS), [[-1.0] * 3, [1.0] * 3])


def test_an_angle_that_is_not_wrapped_has_no_bounds():
    parts = {"Sensor_SunAngle": SunAngleSensor(wrap=False)}
    glue = ObserveSensor(sensor="Sensor_SunAngle")
    np.testing.assert_array_equal(np.ravel(glue.bounds(parts)), [-np.inf, np.inf])
    with pytest.raises(ValueError, match="without bounds"):
        ObserveSensor(sensor="Sensor_SunAngle", normalization=Normalization()).bounds(parts)


def test_names_of_elements():
    assert ObserveSensor().names(PARTS) == ("Sensor_Position.x", "Sensor_Position.y", "Sensor_Position.z")
    assert ControllerGlue(controller="X").names({"X": RateController(name="X")}) == ("X",)


def test_a_normalised_action_spans_the_controllers_limits():
    parts = {"X": RateController(name="X", properties={"low": 0.0, "high": 0.5})}
    glue = ControllerGlue(controller="X")
    np.testing.assert_array_equal(np.ravel(glue.bounds(parts)), [-1.0, 1.0])
    np.testing.assert_allclose(glue(np.array([[-1.0], [0.0], [1.0]]), parts)[:, 0], [0.0, 0.25, 0.5])
    plain = ControllerGlue(controller="X", normalization=Normalization(enabled=False))
    np.testing.assert_array_equal(np.ravel(plain.bounds(parts)), [0.0, 0.5])
    np.testing.assert_array_equal(plain(np.array([[0.3]]), parts), [[0.3, 0.0, 0.0]])


def test_the_shares_of_the_controllers_are_added(fixed_start):
    env = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0)))
    env.reset()
    np.testing.assert_array_equal(env.step(np.array([[[0.1, -0.2, 0.3]]])).step.control, [[0.1, -0.2, 0.3]])
