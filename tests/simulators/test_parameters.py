from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from safe_inspect.errors import ConfigError
from safe_inspect.plugins.functor import build
from safe_inspect.random.streams import Streams
from safe_inspect.simulators import Draw
from safe_inspect.simulators.resets.parameters import (
    ConstantParameter,
    SimAttributeAccessor,
    TruncatedNormalParameter,
    UniformParameter,
)

ROWS = 20_000


def draw(purpose: str = "p", rows: int = ROWS, seed: int = 9, **values: object) -> Draw:
    slots = np.arange(rows)
    return Draw(Streams(seed, slots, np.zeros_like(slots)), purpose, values=values)


def test_a_constant_is_converted_to_si():
    np.testing.assert_array_equal(ConstantParameter(value=1.5, units="km")(draw(rows=3)), [1500.0] * 3)
    np.testing.assert_allclose(ConstantParameter(value=180.0, units="degrees")(draw(rows=1)), [math.pi])


@settings(max_examples=25, deadline=None)
@given(st.floats(-1e6, 1e6), st.floats(0, 1e6), st.sampled_from([("m", 1.0), ("km", 1e3), ("cm", 1e-2)]))
def test_uniform_draws_lie_within_their_bounds(low, width, unit):
    name, factor = unit
    parameter = UniformParameter(low=low, high=low + width, units=name)
    drawn = parameter(draw(rows=200))
    slack = 1e-12 * max(abs(low), abs(low + width), 1.0) * factor
    assert drawn.min() >= low * factor - slack
    assert drawn.max() <= (low + width) * factor + slack


def test_uniform_draws_are_uniform():
    drawn = UniformParameter(low=50.0, high=100.0, units="meters")(draw())
    counts, _ = np.histogram(drawn, bins=10, range=(50.0, 100.0))
    assert counts.sum() == ROWS
    np.testing.assert_allclose(counts, ROWS / 10, rtol=0.1)  # 4.7 standard deviations of 42
    assert drawn.mean() == pytest.approx(75.0, abs=0.5)


def test_bounds_in_the_wrong_order_are_refused():
    with pytest.raises(ValidationError, match="swap them"):
        UniformParameter(low=2.0, high=1.0)
    with pytest.raises(ValidationError, match="not below"):
        TruncatedNormalParameter(low=1.0, high=1.0)


def test_an_unknown_unit_is_refused():
    with pytest.raises(ValidationError, match="did you mean `meter`"):
        ConstantParameter(value=1.0, units="meterz")


def truncated_moments(a: float, b: float) -> tuple[float, float]:
    """Mean and variance of a standard normal within [a, b]."""

    def density(x):
        return math.exp(-x * x / 2.0) / math.sqrt(2.0 * math.pi)

    mass = 0.5 * (math.erfc(a / math.sqrt(2.0)) - math.erfc(b / math.sqrt(2.0)))
    mean = (density(a) - density(b)) / mass
    return mean, 1.0 + (a * density(a) - b * density(b)) / mass - mean * mean


@pytest.mark.parametrize(("a", "b"), [(-1.0, 1.0), (-3.0, 0.5), (0.5, 2.0), (3.0, 4.0), (-9.0, 9.0), (9.0, 10.0)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_moments_of_the_truncated_normal(a, b, sign):
    mu, std = 7.0, 2.0
    bounds = sorted((mu + sign * a * std, mu + sign * b * std))
    drawn = TruncatedNormalParameter(mu=mu, std=std, low=bounds[0], high=bounds[1])(draw())
    assert drawn.min() >= bounds[0]
    assert drawn.max() <= bounds[1]
    mean, variance = truncated_moments(a, b)
    tolerance = 5.0 * math.sqrt(variance / ROWS) * std
    assert drawn.mean() == pytest.approx(mu + sign * mean * std, abs=tolerance)
    assert drawn.var() == pytest.approx(variance * std * std, rel=0.08)


def test_units_of_the_truncated_normal():
    metres = TruncatedNormalParameter(mu=1000.0, std=100.0, low=900.0, high=1300.0)(draw(rows=50))
    kilometres = TruncatedNormalParameter(mu=1.0, std=0.1, low=0.9, high=1.3, units="km")(draw(rows=50))
    np.testing.assert_allclose(kilometres, metres, rtol=1e-12)


def test_an_interval_without_probability_is_refused():
    with pytest.raises(ValidationError, match="too far"):
        TruncatedNormalParameter(mu=0.0, std=1.0, low=50.0, high=51.0)


def test_draws_depend_on_purpose_slot_episode_try_and_seed_alone():
    parameter = UniformParameter(low=0.0, high=1.0)
    whole = parameter(draw("a", 100))
    np.testing.assert_array_equal(parameter(draw("a", 7)), whole[:7])
    one = Draw(Streams(9, np.array([42]), np.array([0])), "a")
    assert parameter(one) == whole[42]
    others = [
        parameter(draw("b", 100)),
        parameter(draw("a", 100, seed=10)),
        parameter(Draw(Streams(9, np.arange(100), np.ones(100, dtype=np.int64)), "a")),
        parameter(Draw(Streams(9, np.arange(100), np.zeros(100, dtype=np.int64)), "a", index=1)),
    ]
    assert len(np.unique(np.concatenate([whole, *others]))) == 500


def test_an_accessor_gives_what_was_drawn_before():
    states = {"position": np.ones((2, 3)), "sun_angle": np.array([0.1, 0.2])}
    at = draw(rows=2, init_state=states, radius=np.array([5.0, 6.0]))
    assert SimAttributeAccessor(attribute_name="init_state")(at) is states
    np.testing.assert_array_equal(SimAttributeAccessor(attribute_name="init_state.sun_angle")(at), [0.1, 0.2])
    np.testing.assert_array_equal(SimAttributeAccessor(attribute_name="radius")(at), [5.0, 6.0])


@pytest.mark.parametrize("name", ["nothing", "init_state.sun_angel", "radius.x", "init_state.position.x"])
def test_an_accessor_to_nothing_says_so(name):
    at = draw(rows=2, init_state={"position": np.ones((2, 3)), "sun_angle": np.zeros(2)}, radius=np.ones(2))
    with pytest.raises(ConfigError, match=name):
        SimAttributeAccessor(attribute_name=name)(at)


def test_the_grammar_of_safe_autonomy_sims_builds_a_parameter():
    mapping = {
        "type": "corl.libraries.parameters.UniformParameter",
        "config": {"name": "radius", "units": "meters", "low": 50, "high": 100},
    }
    built = build("parameter", mapping)
    assert built == UniformParameter(name="radius", units="meters", low=50, high=100)
    assert built.symbol == "m"
