from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic_core import PydanticCustomError

from safe_inspect.errors import InitialStateError
from safe_inspect.plugins.functor import build
from safe_inspect.random.streams import Streams
from safe_inspect.rta import RejectionSampler, RTAGlueCWHInspection1v1
from safe_inspect.rta.constraints import RelativeState, constraint_set
from safe_inspect.simulators import Draw
from safe_inspect.simulators.resets.parameters import UniformParameter


def uniform(low: float, high: float, units: str) -> dict:
    return {"type": "UniformParameter", "config": {"low": low, "high": high, "units": units}}


WRAPPED = {
    "radius": uniform(50, 100, "m"),
    "azimuth_angle": uniform(0, 6.283, "rad"),
    "elevation_angle": uniform(-1.57, 1.57, "rad"),
    "vel_mag": uniform(0, 0.3, "m/s"),
    "vel_azimuth_angle": uniform(0, 6.283, "rad"),
    "vel_elevation_angle": uniform(-1.57, 1.57, "rad"),
    "sun_angle": uniform(0, 6.28, "rad"),
}


def sampler(wrapped: dict | None = None, rta: dict | None = None, **fields: object) -> RejectionSampler:
    mapping = {
        "type": "RejectionSampler",
        "config": {
            "initializer": {"functor": "CWH3DRadialWithSunInitializer"},
            "rta": {"functor": "RTAGlueCWHInspection1v1"} if rta is None else rta,
            **fields,
        },
        "wrapped": WRAPPED | (wrapped or {}),
    }
    built = build("parameter", mapping)
    assert isinstance(built, RejectionSampler)
    return built


def draw(slots: np.ndarray, episode: int = 0, seed: int = 4, **values: object) -> Draw:
    return Draw(Streams(seed, slots, np.full_like(slots, episode)), "init_state", values=values)


def test_accepted_states_satisfy_every_constraint():
    states = sampler()(draw(np.arange(3000)))
    relative = RelativeState(states["position"], states["velocity"], states["sun_angle"])
    for name, constraint in constraint_set({}).items():
        evaluation = constraint.evaluate(relative)
        assert (evaluation.h >= 0.0).all(), name
        assert (evaluation.phi >= 0.0).all(), name


def test_accepted_states_are_the_safe_part_of_the_distribution():
    """Accepting is conditioning: what is accepted is distributed as the safe ones among plain draws."""
    slots = np.arange(6000)
    fast = {"vel_mag": uniform(0, 0.8, "m/s")}  # faster than the task's, so that more than half is refused
    accepted = sampler(fast)(draw(slots))
    plain = RejectionSampler.model_validate(
        {"initializer": {"functor": "CWH3DRadialWithSunInitializer"}, "wrapped": WRAPPED | fast}
    )(draw(slots))
    refusals = RTAGlueCWHInspection1v1().refusals(plain)
    safe = ~np.any(list(refusals.values()), axis=0)
    assert 0.2 < safe.mean() < 0.6
    # The first draw of a row stands when it is safe.
    for name in ("position", "velocity", "sun_angle"):
        np.testing.assert_array_equal(accepted[name][safe], plain[name][safe])
    for quantity in (lambda s: np.linalg.norm(s["position"], axis=1), lambda s: np.linalg.norm(s["velocity"], axis=1),
                     lambda s: np.cos(s["sun_angle"]), lambda s: s["position"][:, 2]):  # fmt: skip
        wanted, got = quantity(plain)[safe], quantity(accepted)
        error = math.hypot(wanted.std() / math.sqrt(safe.sum()), got.std() / math.sqrt(len(got)))
        assert got.mean() == pytest.approx(wanted.mean(), abs=4.5 * error)
        assert got.std() == pytest.approx(wanted.std(), rel=0.05)
    radius = np.linalg.norm(accepted["position"], axis=1)
    assert radius.min() >= 50.0 - 1e-9
    assert radius.max() <= 100.0 + 1e-9


def test_the_draw_of_a_slot_is_the_same_in_any_batch():
    whole = sampler()(draw(np.arange(400)))
    for slots in (np.array([17]), np.array([399, 3, 17]), np.arange(100, 300)):
        part = sampler()(draw(slots))
        for name, array in part.items():
            np.testing.assert_array_equal(array, whole[name][slots])


def test_rows_and_episodes_are_independent():
    first, second = sampler()(draw(np.arange(2000))), sampler()(draw(np.arange(2000), episode=1))
    x, y = first["position"], second["position"]
    assert len(np.unique(np.concatenate((x, y)), axis=0)) == 4000
    for a, b in ((x[:-1, 0], x[1:, 0]), (x[:, 0], y[:, 0]), (x[:, 0], first["velocity"][:, 0])):
        assert abs(np.corrcoef(a, b)[0, 1]) < 0.12  # 5 standard deviations of independent rows


def test_a_row_without_a_safe_state_ends_in_an_error_that_names_the_constraints():
    # Up to 3 m/s at 50 to 100 m breaks the speed limit of 0.2 m/s + 2 n (r - 10 m) nearly always.
    impossible = sampler({"vel_mag": uniform(0.9, 0.95, "m/s")}, max_rejections=7)
    with pytest.raises(InitialStateError, match="init_state") as caught:
        impossible(draw(np.arange(5)))
    message = str(caught.value)
    assert "in 7 draws for 5 environments" in message
    assert "rel_vel 35" in message  # 7 draws of 5 rows
    assert "r_max" not in message  # never refused anything
    assert "widen the limits or narrow the distributions" in message


def test_max_rejections_is_the_number_of_draws():
    hard = {"vel_mag": uniform(0.0, 3.0, "m/s")}
    enough = sampler(hard, max_rejections=2000)(draw(np.arange(50)))
    assert (np.linalg.norm(enough["velocity"], axis=1) < 0.4).all()
    with pytest.raises(InitialStateError):
        sampler(hard, max_rejections=1)(draw(np.arange(50)))


def test_without_a_test_every_draw_is_accepted():
    free = RejectionSampler.model_validate(
        {"initializer": {"functor": "CWH3DRadialWithSunInitializer"}, "wrapped": WRAPPED, "max_rejections": 1}
    )
    assert free(draw(np.arange(100)))["position"].shape == (100, 3)


def test_a_state_is_safe_when_it_is_safe_now_and_can_be_kept_so():
    """h and phi both count: at 12 m towards the chief with 2 m/s, and at 9 m away from it."""
    glue = RTAGlueCWHInspection1v1(constraints=("chief_collision",))
    states = {
        "position": np.array([[12.0, 0, 0], [12.0, 0, 0], [9.0, 0, 0]]),
        "velocity": np.array([[0.0, 0, 0], [-2.0, 0, 0], [2.0, 0, 0]]),
        "sun_angle": np.zeros(3),
    }
    assert glue.refusals(states)["chief_collision"].tolist() == [False, True, True]


def test_a_state_that_is_nan_is_refused():
    states = {
        "position": np.array([[60.0, 0, 0], [np.nan, 0, 0], [60.0, 0, 0]]),
        "velocity": np.array([[0.0, 0, 0], [0.0, 0, 0], [0.0, np.nan, 0]]),
        "sun_angle": np.full(3, math.pi),
    }
    refused = np.any(list(RTAGlueCWHInspection1v1().refusals(states).values()), axis=0)
    assert refused[1:].all()


def test_a_wrapped_parameter_may_mean_one_drawn_before():
    """An accessor keeps its rows apart while some rows are drawn again."""
    slots = np.arange(300)
    sun = UniformParameter(low=0.0, high=6.28)(Draw(Streams(4, slots, np.zeros_like(slots)), "sun"))
    states = sampler({"sun_angle": {"type": "SimAttributeAccessor", "config": {"attribute_name": "theta"}}})(
        draw(slots, theta=sun)
    )
    np.testing.assert_array_equal(states["sun_angle"], sun)


ARGUMENTS = {"functor": "RTAGlueCWHInspection1v1", "args": {"collision_radius": 10, "velocity_threshold": 0.2}}


@pytest.mark.parametrize(
    ("mapping", "place", "words"),
    [
        ({"wrapped": {"radius": uniform(50, 100, "kg")}}, "wrapped.radius.config.units", "in kg"),
        ({"wrapped": {"raduis": uniform(50, 100, "m")}}, "wrapped.raduis", "did you mean `radius`"),
        ({"rta": ARGUMENTS | {"arg_map": {"v0": "velocty_threshold"}}}, "config.rta.arg_map.v0", "velocity_threshold"),
        ({"rta": ARGUMENTS | {"args": {"c": -1}, "arg_map": {"collision_radius": "c"}}}, "config.rta.args.c", "0"),
        ({"rta": {"functor": "ObserveSensor"}}, "config.rta.functor", "is not a safety glue"),
        ({"rta": ARGUMENTS | {"states": ["position", "velocity"]}}, "config.rta.states", "`sun_angle`"),
        (
            {"rta": ARGUMENTS | {"states": ["position", "velocity", "sun_angle", "spin"]}},
            "config.rta.states.3",
            "no state 'spin'",
        ),
        ({"max_rejections": 0}, "config.max_rejections", "1"),
    ],
)
def test_mistakes_are_reported_with_their_place(mapping, place, words):
    fields = dict(mapping)
    with pytest.raises(PydanticCustomError) as caught:
        sampler(fields.pop("wrapped", None), fields.pop("rta", None), **fields)
    context = caught.value.context
    problems = [(".".join(map(str, error["loc"])), error["msg"]) for error in flat(context["errors"])]
    assert [(where, words in message) for where, message in problems] == [(place, True)]


def flat(errors):
    for error in errors:
        if error["type"] == "functor":
            for inner in flat(error["ctx"]["errors"]):
                yield {**inner, "loc": (*error["loc"], *inner["loc"])}
        else:
            yield error


@pytest.mark.parametrize(
    ("wrapped", "left_out", "message"),
    [
        ({"vel_magg": uniform(0, 1, "m/s")}, "", "takes no 'vel_magg'; did you mean `vel_mag`"),
        ({"vel_mag": uniform(0, 1, "m")}, "", "'vel_mag' is given in m, but is measured in m/s"),
        ({}, "vel_mag", "CWH3DRadialWithSunInitializer needs `vel_mag`"),
    ],
)
def test_parameters_that_the_initialiser_does_not_take_or_lacks_are_named(wrapped, left_out, message):
    kept = {name: value for name, value in (WRAPPED | wrapped).items() if name != left_out}
    mapping = {
        "type": "RejectionSampler",
        "config": {
            "initializer": {"functor": "CWH3DRadialWithSunInitializer"},
            "rta": {"functor": "RTAGlueCWHInspection1v1"},
        },
        "wrapped": kept,
    }
    with pytest.raises(PydanticCustomError) as caught:
        build("parameter", mapping)
    assert message in str(caught.value) + str(caught.value.context)
