"""Initial states by plain formulas of the draws that they depend on, and how those of a team are kept apart."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.stats import norm, truncnorm

from safe_inspect.errors import ConfigError, InitialStateError
from safe_inspect.plugins.registry import registry
from safe_inspect.random.streams import Streams
from safe_inspect.simulators import Draw
from safe_inspect.simulators.resets.initializers import (
    AttitudeParameter,
    Initializer,
    PositionVelocityInitializer,
    drawn_attitude,
    repeated_unit,
)
from safe_inspect.simulators.resets.parameters import (
    ConstantParameter,
    Parameter,
    SimAttributeAccessor,
    TruncatedNormalParameter,
    UniformParameter,
)
from safe_inspect.simulators.resets.plan import BodyReset, EnvironmentDraw, ResetPlan

ROWS = 7
STREAMS = Streams(5, np.arange(ROWS), np.full(ROWS, 2))
BODY = ("x", "y", "z", "x_dot", "y_dot", "z_dot")
GIVING = [
    name
    for name, plugin in registry.items("initializer")
    if plugin.gives and plugin.__module__.startswith("safe_inspect.")
]


@pytest.mark.parametrize("name", GIVING)
def test_an_initializer_gives_what_it_declares(name: str) -> None:
    """With numbers of parameters at their own places: the polar ones at an azimuth and an elevation."""
    plugin = registry.get("initializer", name)()
    values: dict[str, Any] = {key: STREAMS.uniform(key)[:, 0] for key in plugin.parameters}
    if "orientation" in values:
        values["orientation"] = {"orientation": drawn_attitude(Draw(STREAMS, "q"))}
    found = plugin(values)
    assert found.keys() == plugin.gives.keys()
    for key, size in plugin.gives.items():
        assert found[key].shape == ((ROWS,) if size == 1 else (ROWS, size)), key
    if "vel_mag" in values:
        for state, radius, azimuth, elevation in (
            ("position", "radius", "azimuth_angle", "elevation_angle"),
            ("velocity", "vel_mag", "vel_azimuth_angle", "vel_elevation_angle"),
        ):
            r, az, el = (values[key] for key in (radius, azimuth, elevation))
            np.testing.assert_allclose(found[state][:, 0], r * np.cos(az) * np.cos(el), rtol=1e-14)
            np.testing.assert_allclose(found[state][:, 1], r * np.sin(az) * np.cos(el), rtol=1e-14)
            np.testing.assert_allclose(found[state][:, 2], r * np.sin(el), rtol=1e-14)
    if "wx" in values:
        np.testing.assert_array_equal(found["angular_velocity"], np.stack([values[w] for w in ("wx", "wy", "wz")], 1))
        assert found["orientation"] is values["orientation"]["orientation"]


def test_attitudes_are_those_of_shoemake_or_the_given_one() -> None:
    for index in (0, 3):
        u1, u2, u3 = STREAMS.uniform("a", 3, index).T
        expected = [
            np.sqrt(1.0 - u1) * np.sin(2.0 * np.pi * u2), np.sqrt(1.0 - u1) * np.cos(2.0 * np.pi * u2),
            np.sqrt(u1) * np.sin(2.0 * np.pi * u3), np.sqrt(u1) * np.cos(2.0 * np.pi * u3),
        ]  # fmt: skip
        found = AttitudeParameter()(Draw(STREAMS, "a", index))["orientation"]
        np.testing.assert_allclose(found, np.transpose(expected), rtol=1e-13)
    fixed = AttitudeParameter(orientation=(0.0, 3.0, 0.0, -4.0))(Draw(STREAMS, "a"))["orientation"]
    np.testing.assert_allclose(fixed, np.tile([0.0, 0.6, 0.0, -0.8], (ROWS, 1)), rtol=1e-15)
    np.testing.assert_allclose(repeated_unit((2.0, -1.0, 2.0), 4), np.tile([2 / 3, -1 / 3, 2 / 3], (4, 1)), rtol=1e-15)
    with pytest.raises(ValidationError, match="all components are 0, which is neither a direction nor an attitude"):
        AttitudeParameter(orientation=(0.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize("index", [0, 4])
def test_scalars_are_the_quantiles_of_their_draws(index: int) -> None:
    draw = Draw(STREAMS, "p", index)
    u = STREAMS.uniform("p", index=index)[:, 0]
    np.testing.assert_allclose(UniformParameter(low=-3.0, high=5.0)(draw), -3.0 + 8.0 * u, rtol=1e-14)
    np.testing.assert_allclose(
        UniformParameter(low=90.0, high=180.0, units="degrees")(draw), np.pi * (0.5 + 0.5 * u), rtol=1e-14
    )
    assert UniformParameter(low=2.0, high=2.0)(draw).tolist() == [2.0] * ROWS
    assert (UniformParameter()(draw) == u).all()
    assert ConstantParameter(value=3.0, units="km")(draw).tolist() == [3000.0] * ROWS
    assert not ConstantParameter()(draw).any()
    np.testing.assert_allclose(TruncatedNormalParameter()(draw), norm.ppf(u), rtol=1e-9)
    for mu, std, low, high in (
        (1.0, 2.0, -3.0, 4.0),
        (0.0, 1.0, 1.5, 9.0),
        (5.0, 2.0, -np.inf, 1.0),
        (-2.0, 0.5, -2.0, 9),
    ):
        found = TruncatedNormalParameter(mu=mu, std=std, low=low, high=high, units="km")(draw)
        # above its mean a quantile is counted from above, where a tail keeps its digits
        share = 1.0 - u if low > mu else u
        expected = truncnorm.ppf(share, (low - mu) / std, (high - mu) / std, loc=mu, scale=std)
        np.testing.assert_allclose(found, 1000.0 * expected, rtol=1e-9)


@pytest.mark.parametrize(("units", "symbol", "factor"), [(None, None, 1.0), ("km", "m", 1000.0)])
def test_a_parameter_knows_its_unit(units: str | None, symbol: str | None, factor: float) -> None:
    parameter = ConstantParameter(units=units)
    assert parameter.symbol == symbol
    assert parameter.factor == factor
    assert SimAttributeAccessor().symbol is None


def test_an_accessor_to_nothing_names_what_there_is() -> None:
    draw = Draw(STREAMS, "blue0.x", values={"init_state": {"position": np.zeros((ROWS, 3))}})
    assert SimAttributeAccessor(attribute_name="init_state.position")(draw) is draw.values["init_state"]["position"]
    for name, hint in (("init_state.positon", "position"), ("init_stat", "init_state"), ("init_state.position.x", "")):
        with pytest.raises(ConfigError) as refusal:
            SimAttributeAccessor(attribute_name=name)(draw)
        assert f"`{name}` is not a reset parameter; " in str(refusal.value)
        assert hint in str(refusal.value)
        assert "blue0.x" in str(refusal.value)
    assert draw.child("y").purpose == "blue0.x.y"
    assert Draw(STREAMS, "").child("y").purpose == "y"


class OneOfTries(Parameter, name="TestOneOfTries"):
    """Far away from the try of a number on, at the origin before."""

    tries: int = 0
    far: float = 100.0

    def __call__(self, draw: Draw) -> np.ndarray:
        return np.full(len(draw.streams), self.far if draw.index >= self.tries else 0.0)


def body(**parameters: Parameter) -> BodyReset:
    return BodyReset(PositionVelocityInitializer(), {name: ConstantParameter() for name in BODY} | parameters)


@pytest.mark.parametrize(("tries", "found"), [(0, True), (1, True), (99, True), (100, False)])
def test_a_deputy_is_drawn_a_hundred_times_at_most(tries: int, found: bool) -> None:
    deputies = {"a": body(), "b": body(y=ConstantParameter(value=9.0)), "c": body(x=OneOfTries(tries=tries))}
    plan = ResetPlan({}, deputies, {}, separation=5.0)
    if found:
        assert (plan.draw(STREAMS)[0]["c"]["position"] == [100.0, 0.0, 0.0]).all()
        return
    with pytest.raises(InitialStateError) as refusal:
        plan.draw(STREAMS)
    assert str(refusal.value) == (
        "c starts closer than 5 m to a or b in 7 of 7 environments; give each deputy its own initial state"
    )


@pytest.mark.parametrize(("x", "near"), [(5.0, False), (5.0 - 1e-12, True), (-5.0, False)])
def test_deputies_at_the_separation_are_apart(x: float, near: bool) -> None:
    for axis in ("x", "y", "z"):
        plan = ResetPlan({}, {"a": body(), "b": body(**{axis: ConstantParameter(value=x)})}, {}, separation=5.0)
        if near:
            with pytest.raises(InitialStateError, match="b starts closer than 5 m to a in 7 of 7 environments"):
                plan.draw(STREAMS)
        else:
            plan.draw(STREAMS)
    ResetPlan({}, {"a": body(), "b": body()}, {}).draw(STREAMS)  # without a separation all may be at one place


def test_only_rows_that_are_too_near_are_drawn_again() -> None:
    uniform = UniformParameter(low=0.0, high=10.0)
    bodies, _ = ResetPlan({}, {"a": body(), "b": body(x=uniform)}, {}, separation=5.0).draw(STREAMS)
    tries = np.stack([uniform(Draw(STREAMS, "b.x", index)) for index in range(60)])
    np.testing.assert_array_equal(bodies["b"]["position"][:, 0], tries[(tries >= 5.0).argmax(axis=0), np.arange(ROWS)])
    assert (tries[0] < 5.0).any()
    assert (tries[0] >= 5.0).any()


class Accepted(Parameter, name="TestAccepted"):
    """States that are refused while a test refuses them, as a rejection sampler's, with statistics."""

    def __call__(self, draw: Draw) -> dict[str, np.ndarray]:
        count, rows = len(draw.streams), np.arange(len(draw.streams))
        position, rejected = np.zeros((count, 3)), np.zeros(count)
        for index in range(50):
            position[rows, 0] = Draw(draw.streams[rows], draw.purpose, index).streams.uniform(
                draw.purpose, index=index
            )[:, 0]
            if draw.test is None:
                break
            refused = draw.test({"position": position[rows]}, rows)
            assert all(mask.shape == rows.shape for mask in refused.values())
            bad = np.logical_or.reduce([np.zeros(len(rows), bool), *refused.values()])
            rejected[rows] += bad
            rows = rows[bad]
            if not len(rows):
                break
        sun = draw.fixed.get("sun_angle", STREAMS.uniform("sun")[:, 0])
        return {"position": position, "velocity": position * 0.0, "sun_angle": sun, "rejected/all": rejected}


class Taken(Initializer, name="TestTaken"):
    """Takes the states over."""

    def __call__(self, values: Mapping[str, Any]) -> dict[str, np.ndarray]:
        return {name: values["init_state"][name] for name in ("position", "velocity")}


def test_a_team_is_drawn_one_deputy_after_another_with_one_sun() -> None:
    """A reset parameter that gives states is drawn for each deputy; what is the environment's stays."""
    deputy, seen = BodyReset(Taken(), {"init_state": SimAttributeAccessor()}), []
    asked: list[tuple[int, tuple[int, ...]]] = []

    def test(states: Mapping[str, Any], index: int, before: Mapping[str, Any]) -> dict[str, np.ndarray]:
        asked.append((index, before["position"].shape[1:] if before else ()))
        return {"separation": states["position"][:, 0] > 0.9, "other": states["position"][:, 0] < 0.05}

    plan = ResetPlan(
        {"init_state": Accepted(), "number": UniformParameter()}, {"a": deputy, "b": deputy, "c": deputy},
        {"chief": body()},
        (EnvironmentDraw("sun_angle", "s", SimAttributeAccessor(attribute_name="init_state.sun_angle")),),
        0.1, (test,), (lambda bodies, values: seen.append((list(bodies), list(values))),),
    )  # fmt: skip
    assert deputy.sources == ("init_state",)
    assert (deputy.draws, body().draws) == (False, True)
    bodies, values = plan.draw(STREAMS)
    x = np.stack([bodies[name]["position"][:, 0] for name in ("a", "b", "c")])
    assert ((x >= 0.05) & (x <= 0.9)).all()
    assert all((np.abs(x[i] - x[j]) >= 0.1).all() for i in range(3) for j in range(i))
    assert seen == [(["a", "b", "c", "chief"], ["init_state", "number", "sun_angle"])]
    np.testing.assert_array_equal(values["sun_angle"], STREAMS.uniform("sun")[:, 0])
    assert dict(asked) == {0: (), 1: (1, 3), 2: (2, 3)}
    state = values["init_state"]
    assert isinstance(state, dict)
    # the statistics are those of all three, of which the first was refused least often
    tries = np.zeros(ROWS)
    for index, purpose in enumerate(("init_state", "init_state@1", "init_state@2")):
        draws = np.stack([STREAMS.uniform(purpose, index=k)[:, 0] for k in range(50)])
        near = np.zeros(draws.shape, bool)
        for other in range(index):
            near |= np.abs(draws - x[other]) < 0.1
        tries += ((draws >= 0.05) & (draws <= 0.9) & ~near).argmax(axis=0)
    np.testing.assert_array_equal(state["rejected/all"], tries)
    assert tries.sum() > 3
