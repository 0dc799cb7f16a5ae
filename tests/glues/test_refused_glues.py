"""Glues whose fields, or whose wrapped glues, do not fit are refused with what is wrong."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.errors import ConfigError
from safe_inspect.glues.actions import CoastGlue, DiscreteControllerGlue
from safe_inspect.glues.attitude import DotProductGlue


@pytest.mark.parametrize(
    ("glue", "fields", "message"),
    [
        (CoastGlue, {"durations": ()}, "`durations` is empty; give one or more numbers"),
        (CoastGlue, {"durations": (0, 1)}, "greater than or equal to 1"),
        (CoastGlue, {"durations": (1, 4, 4)}, r"`durations` \[1, 4, 4\] must be in ascending order"),
        (CoastGlue, {"durations": (4, 1)}, r"`durations` \[4, 1\] must be in ascending order"),
        (DiscreteControllerGlue, {"levels": (1.0, 0.0)}, r"`levels` \[1.0, 0.0\] must be in ascending order"),
        (DiscreteControllerGlue, {"levels": (0.0, 0.0)}, r"`levels` \[0.0, 0.0\] must be in ascending order"),
        (DiscreteControllerGlue, {"levels": (0.0,)}, "at least 2 items"),
        (DotProductGlue, {"wrapped": [{"functor": "ObserveSensor", "config": {"sensor": "Sensor_Position"}}]},
         "Field required"),
    ],
)  # fmt: skip
def test_fields_that_do_not_fit(glue, fields, message):
    with pytest.raises(ValidationError, match=message):
        glue(**fields)


def test_durations_and_levels_that_fit_are_kept():
    np.testing.assert_array_equal(CoastGlue(durations=(1, 3)).table, [1, 3])
    np.testing.assert_array_equal(DiscreteControllerGlue(levels=(-0.5, 0.5)).table, [-0.5, 0.5])


def sensed(name: str) -> str:
    return f"{{functor: ObserveSensor, config: {{sensor: {name}, normalization: {{enabled: False}}}}}}"


@pytest.mark.parametrize(
    ("glue", "message"),
    [
        (f"{{functor: MagNorm3DGlue, config: {{wrapped: {sensed('Sensor_Speed')}}}}}",
         "`wrapped` must be a vector of 3 elements, not of 1"),
        (f"{{functor: AngleToUnitVector, config: {{wrapped: {sensed('Sensor_Position')}}}}}",
         "`wrapped` must be one angle, not 3 numbers"),
        (f"{{functor: DotProductGlue, config: {{wrapped: [{sensed('Sensor_Position')}, {sensed('Sensor_Speed')}]}}}}",
         "the two vectors have 3 and 1 elements"),
    ],
)  # fmt: skip
def test_wrapped_glues_of_other_sizes(glue, message):
    path = configs_root() / "docking" / "experiment.yml"
    with pytest.raises(ConfigError, match=message):
        load_experiment(path, [f"agent_config.blue0_ctrl.config.config.glues.2={glue}"])
