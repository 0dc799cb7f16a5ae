"""The test kit finds what a plugin does wrong, and says what to do."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict

from safe_inspect.dones import DoneFunction, DoneStatus
from safe_inspect.glues import ActionGlue, Normalizer, ObservationGlue
from safe_inspect.platforms import Controller, Sensor
from safe_inspect.plugins import Plugin, SensorName
from safe_inspect.plugins.functor import functor_field
from safe_inspect.plugins.registry import registry
from safe_inspect.rewards import Reward
from safe_inspect.rta.constraints import Constraint, ConstraintValues
from safe_inspect.simulators import Initializer, Parameter
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.testing import check_plugin
from safe_inspect.units import PositiveLength

from .reports import breaches

pytestmark = pytest.mark.usefixtures("clean_registry")


def test_a_good_plugin_passes() -> None:
    class GoodReward(Reward):
        """Pay for a small range: -range / `scale`.

        Attributes:
            scale: Range that costs 1 [m].
        """

        scale: PositiveLength = 100.0

        def __call__(self, step):
            return -step.after.range_to(None) / self.scale

    check_plugin(GoodReward)
    check_plugin(GoodReward(scale="2 km"))


class TestDeclaration:
    def test_what_is_not_a_plugin(self) -> None:
        with pytest.raises(TypeError, match="is not a plugin"):
            check_plugin(int)  # type: ignore[arg-type]
        with pytest.raises(TypeError, match="is not a plugin"):
            check_plugin("reward")  # type: ignore[arg-type]

    def test_abstract(self) -> None:
        found = breaches(Reward)
        assert set(found) == {"defaults"}

    def test_no_defaults(self) -> None:
        class NeedsScaleReward(Reward):
            """Pay `scale`.

            Attributes:
                scale: Reward of a step [-].
            """

            scale: float

            def __call__(self, step):
                return np.full(len(step.control), self.scale)

        assert "`scale`: Field required" in breaches(NeedsScaleReward)["defaults"]
        check_plugin(NeedsScaleReward(scale=2.0))

    def test_default_that_is_invalid(self) -> None:
        class NegativeReward(Reward):
            """Pay 1.

            Attributes:
                length: A length [m].
            """

            length: PositiveLength = -1.0

            def __call__(self, step):
                return np.ones(len(step.control))

        assert "length" in breaches(NegativeReward)["defaults"]

    def test_loose_and_mutable(self) -> None:
        class LooseReward(Reward):
            """Pay 1."""

            model_config = ConfigDict(frozen=False, extra="allow")

            def __call__(self, step):
                return np.ones(len(step.control))

        found = breaches(LooseReward)
        assert set(found) == {"frozen", "strict"}
        assert "no_such_field" in found["strict"]

    def test_loose_model_in_a_field(self) -> None:
        class Inner(BaseModel):
            value: float = 1.0

        class NestedReward(Reward):
            """Pay 1.

            Attributes:
                inner: A model.
            """

            inner: Inner | None = Inner()

            def __call__(self, step):
                return np.ones(len(step.control))

        assert "`inner`" in breaches(NestedReward)["strict"]

    def test_field_that_takes_anything(self) -> None:
        class AnyReward(Reward):
            """Pay 1.

            Attributes:
                thing: Whatever.
            """

            thing: Any = 1

            def __call__(self, step):
                return np.ones(len(step.control))

        assert "`thing` accepts any object" in breaches(AnyReward)["strict"]

    def test_documentation(self) -> None:
        class BareReward(Reward):
            scale: float = 1.0
            length: PositiveLength = 1.0

            def __call__(self, step):
                return np.ones(len(step.control))

        class HalfReward(Reward):
            """pay something

            Attributes:
                scale: Reward of a step.
                length: Largest range in metres.
                lenght: A field of another name [m].
            """

            scale: float = 1.0
            length: PositiveLength | None = 1.0

            def __call__(self, step):
                return np.ones(len(step.control))

        bare = breaches(BareReward)
        assert set(bare) == {"documented"}
        assert all(text in bare["documented"] for text in ("has no docstring", "`scale`", "`length`"))
        half = breaches(HalfReward)
        assert "not a sentence" in half["documented"]
        assert re.search(r"`lenght`.*did you mean `length`", half["documented"])
        assert "`scale`" not in half["documented"]
        assert "[m]" in half["units"]

    def test_what_does_not_survive_yaml(self) -> None:
        class HoldingReward(Reward):
            """Pay what another reward pays.

            Attributes:
                other: The other.
            """

            model_config = ConfigDict(arbitrary_types_allowed=True)

            other: Plugin | None = None

            def __call__(self, step):
                return np.zeros(len(step.control))

        class PayOneReward(Reward):
            """Pay 1."""

            def __call__(self, step):
                return np.ones(len(step.control))

        assert "yaml" in breaches(HoldingReward(other=PayOneReward()))

        class HolderReward(Reward):
            """Pay what another reward pays.

            Attributes:
                wrapped: The other.
            """

            wrapped: functor_field("reward") = PayOneReward()

            def __call__(self, step):
                return self.wrapped(step)

        check_plugin(HolderReward)

    def test_name_that_the_sample_world_does_not_have(self) -> None:
        class SensingReward(Reward):
            """Pay the first element of a reading.

            Attributes:
                sensor: The sensor.
            """

            sensor: SensorName = "Sensor_Positon"

            def __call__(self, step):
                return step.after.reading(self.sensor)[:, 0]

        class OneSensor(Sensor):
            """One [-], shape (R, 1)."""

            elements: ClassVar[tuple[str, ...]] = ("one",)

            def __call__(self, view):
                return np.ones((view.num_rows, 1))

        assert "did you mean `Sensor_Position`?" in breaches(SensingReward)["names"]
        check_plugin(SensingReward(sensor="Sensor_Position"))
        check_plugin(SensingReward(sensor="OneSensor"), parts=[OneSensor()])

    def test_without_call_it_is_no_plugin(self) -> None:
        class Callless(Plugin):
            """Nothing."""

            kind: ClassVar[str] = "reward"

        assert "registered" in breaches(Callless)


class TestValues:
    @pytest.mark.parametrize(
        ("compute", "rule"),
        [
            (lambda step: 1.0, "shape"),
            (lambda step: None, "shape"),
            (lambda step: np.ones(3), "shape"),
            (lambda step: step.control, "shape"),
            (lambda step: step.after.step, "shape"),
            (lambda step: step.intervening, "shape"),
            (lambda step: np.array(1.0), "shape"),
            (lambda step: np.log(step.after.range_to(None) - 50.0), "finite"),
            (lambda step: 1.0 / step.before.time, "finite"),
            (lambda step: step.after.no_such_thing, "runs"),
            (lambda step: step.after.step - step.after.step.mean(), "row-wise"),
            (lambda step: np.sort(step.after.time), "row-wise"),
            (lambda step: np.full(len(step.control), 1.0 / len(step.control)), "row-wise"),
            (lambda step: np.where(step.first.all(), step.after.time, -1.0) * np.ones(len(step.control)), "row-wise"),
            (lambda step: np.zeros(48), "row-wise|shape|runs"),
            (lambda step: np.random.default_rng().random(len(step.control)), "no memory"),
        ],
    )  # fmt: skip
    @pytest.mark.filterwarnings("ignore::RuntimeWarning")
    def test_reward(self, compute: Any, rule: str) -> None:
        class BadReward(Reward):
            """Pay something."""

            def __call__(self, step):
                return compute(step)

        assert any(re.fullmatch(rule, found) for found in breaches(BadReward))

    @pytest.mark.parametrize(
        "change",
        [
            lambda step: step.after.position,
            lambda step: step.before.state.delta_v,
            lambda step: step.control,
            lambda step: step.action,
        ],
        ids=["position", "delta_v", "control", "action"],
    )
    def test_changed_inputs(self, change: Any) -> None:
        class ChangingReward(Reward):
            """Pay 1 and leave a trace."""

            def __call__(self, step):
                given = change(step)
                given += 1.0
                return np.ones(len(step.control))

        found = breaches(ChangingReward)
        assert set(found) == {"inputs unchanged"}
        assert "given += 1.0" in found["inputs unchanged"]

    def test_changed_range_that_others_share(self) -> None:
        class SpoilingReward(Reward):
            """Pay for the range beyond 10 m."""

            def __call__(self, step):
                distance = step.after.range_to(None)
                distance -= 10.0
                return distance

        assert set(breaches(SpoilingReward)) == {"inputs unchanged"}

    def test_memory_between_calls(self) -> None:
        class CountingReward(Reward):
            """Pay the number of the call."""

            _calls: ClassVar[list[int]] = []

            def __call__(self, step):
                self._calls.append(1)
                return np.full(len(step.control), float(len(self._calls)))

        class LastBatchReward(Reward):
            """Pay 1 after a batch of the same size, else 0."""

            _last: ClassVar[list[int]] = [48]

            def __call__(self, step):
                same = self._last[0] == len(step.control)
                self._last[0] = len(step.control)
                return np.full(len(step.control), float(same))

        assert set(breaches(CountingReward)) >= {"no memory"}
        assert set(breaches(LastBatchReward)) & {"no memory", "row-wise"}

    def test_done(self) -> None:
        class NumberDone(DoneFunction):
            """End sometimes."""

            status: ClassVar[DoneStatus] = DoneStatus.RUNNING

            def __call__(self, step):
                return step.after.time

        class NoStatusDone(DoneFunction):
            """End never."""

            def __call__(self, step):
                return step.after.time < 0.0

        assert {"status", "shape"} == set(breaches(NumberDone))
        assert {"status"} == set(breaches(NoStatusDone))

    def test_sensor(self) -> None:
        class WideSensor(Sensor):
            """Range [m], of the wrong shape."""

            elements: ClassVar[tuple[str, ...]] = ("range",)

            def __call__(self, view):
                return view.range_to(None)

        class UnboundSensor(Sensor):
            """Range [m], outside of its bounds."""

            elements: ClassVar[tuple[str, ...]] = ("range",)
            bounds: ClassVar[tuple[float, float]] = (0.0, 100.0)

            def __call__(self, view):
                return view.range_to(None)[:, None]

        class TwinSensor(Sensor):
            """Two elements of one name."""

            elements: ClassVar[tuple[str, ...]] = ("a", "a")

            def __call__(self, view):
                return view.position[:, :2]

        assert "(R, 1)" in breaches(WideSensor)["shape"]
        assert "bounds" in breaches(UnboundSensor)
        assert "elements" in breaches(TwinSensor)

    def test_sensor_that_remembers_the_batch(self) -> None:
        class CrowdSensor(Sensor):
            """Sum of the batch's times [s]."""

            elements: ClassVar[tuple[str, ...]] = ("sum",)

            def memory(self, world) -> Mapping[str, ArraySpec]:
                return {"sum": ArraySpec(())}

            def remember(self, view, name):
                view.memory(name, "sum")[:] += view.time.sum()

            def __call__(self, view):
                return view.memory(self.part_name, "sum")[:, None].copy()

        class PathSensor(Sensor):
            """Sum of the own ranges [m]."""

            elements: ClassVar[tuple[str, ...]] = ("sum",)

            def memory(self, world) -> Mapping[str, ArraySpec]:
                return {"sum": ArraySpec(())}

            def remember(self, view, name):
                view.memory(name, "sum")[:] += view.range_to(None)

            def __call__(self, view):
                return view.memory(self.part_name, "sum")[:, None].copy()

        assert "batch" in breaches(CrowdSensor)["row-wise"]
        check_plugin(PathSensor)

    def test_controller(self) -> None:
        class FlatController(Controller):
            """Thrust along x [N]."""

            @property
            def limits(self):
                return np.array([-1.0]), np.array([1.0])

            def __call__(self, values):
                values *= 2.0
                return values

        class LimitlessController(Controller):
            """Thrust along x [N]."""

            @property
            def limits(self):
                return np.array([1.0]), np.array([-1.0])

            def __call__(self, values):
                return np.zeros((len(values), 3))

        assert "(R, 3)" in breaches(FlatController)["shape"]
        assert "limits" in breaches(LimitlessController)

    def test_glues(self) -> None:
        class ShortGlue(ObservationGlue):
            """Two names for three values."""

            def names(self, parts):
                return ("x", "x")

            def bounds(self, parts):
                return np.full(2, -np.inf), np.full(2, np.inf)

            def __call__(self, view):
                return view.position

        class BoundlessGlue(ActionGlue):
            """No bounds for one command."""

            def names(self, parts):
                return ("x",)

            def bounds(self, parts):
                return np.empty(0), np.empty(0)

            def __call__(self, action, parts):
                return np.zeros((len(action), 3))

        class ThrustlessGlue(ActionGlue):
            """The action itself, which is no thrust."""

            def names(self, parts):
                return ("x",)

            def bounds(self, parts):
                return np.array([-1.0]), np.array([1.0])

            def __call__(self, action, parts):
                return action

        assert {"names", "shape"} <= set(breaches(ShortGlue))
        assert set(breaches(BoundlessGlue)) == {"bounds"}
        assert "thrust" in breaches(ThrustlessGlue)["shape"]

    def test_normalizer(self) -> None:
        class OneWayNormalizer(Normalizer):
            """Half of the values, whose inverse is wrong."""

            def __call__(self, values, low, high):
                return values / 2.0

            def inverse(self, values, low, high):
                return values * 3.0

        assert set(breaches(OneWayNormalizer)) == {"inverse"}

    def test_parameter_and_initializer(self) -> None:
        class BatchParameter(Parameter):
            """A number for the batch."""

            def __call__(self, draw):
                return draw.streams.uniform("x")[:, 0] + len(draw.streams)

        class LostInitializer(Initializer):
            """A position, without the velocity that it promises."""

            parameters: ClassVar[Mapping[str, str | None]] = {"x": "m"}
            gives: ClassVar[tuple[str, ...]] = ("position", "velocity")

            def __call__(self, values):
                return {"position": np.stack([values["x"]] * 2, axis=-1)}

        class ShortInitializer(Initializer):
            """A position alone."""

            parameters: ClassVar[Mapping[str, str | None]] = {"x": "m"}
            gives: ClassVar[tuple[str, ...]] = ("position", "velocity")

            def __call__(self, values):
                return {"position": np.stack([values["x"]] * 3, axis=-1)}

        assert "row-wise" in breaches(BatchParameter)
        assert "position" in breaches(LostInitializer)["shape"]
        assert "velocity" in breaches(ShortInitializer)["gives"]

    def test_constraint(self) -> None:
        class TwofoldConstraint(Constraint):
            """Two different phi.

            Attributes:
                alpha_linear: Linear coefficient of alpha [1/s].
            """

            def evaluate(self, state):
                out = ConstraintValues.zeros(len(state))
                out.phi[:] = state.position[:, 0]
                return out

            def __call__(self, state):
                return state.position[:, 1].copy()

        class FlatConstraint(Constraint):
            """A gradient of the wrong shape."""

            def evaluate(self, state):
                rows = len(state)
                return ConstraintValues(np.zeros(rows), np.zeros(rows), np.zeros((rows, 3)), np.zeros(rows))

        assert "phi" in breaches(TwofoldConstraint)
        assert "gradient" in breaches(FlatConstraint)["shape"]

    @pytest.mark.parametrize("factor", [1.0, -1.0, 7.0, 1.01, 0.0], ids=str)
    def test_the_gradient_of_a_constraint(self, factor: float) -> None:
        class BrakingSlab(Constraint):
            """Stay able to brake before z = 300 m: h = 300 m - z - v |v| / (2 a)."""

            wrong: float = 1.0
            alpha_linear: float = 0.05

            def evaluate(self, state):
                height, speed = state.position[:, 2], state.velocity[:, 2]
                gradient = np.zeros((len(state), 6))
                gradient[:, 2], gradient[:, 5] = -1.0, -self.wrong * np.abs(speed) / 0.08
                h = 300.0 - height - speed * np.abs(speed) / 0.16
                return ConstraintValues(300.0 - height, h, gradient, np.zeros(len(state)))

        plugin = BrakingSlab(wrong=factor)
        found = breaches(plugin)
        found.pop("documented")  # the field of the test
        if factor == 1.0:
            assert not found
        elif factor:
            assert set(found) == {"gradient"}
            assert "the derivative of h in" in found["gradient"]
            assert "560 states" in found["gradient"] or "of 48 states" in found["gradient"]
        else:
            assert set(found) == {"gradient", "thrust"}

    @pytest.mark.parametrize(
        ("fault", "words"),
        [
            ("", ""),
            ("wrong sign", "a state with phi < 0 lies within it"),
            ("NaN", "the direction or the need is not finite, or the direction is 0"),
            ("zero", "the direction or the need is not finite, or the direction is 0"),
            ("infinite need", "the direction or the need is not finite, or the direction is 0"),
            ("too far", "a state with phi > 0 is not within its own half-space"),
            ("too near", "a state with phi < 0 lies within it"),
        ],
    )
    def test_the_half_space_of_a_constraint(self, fault: str, words: str) -> None:
        class Ceiling(Constraint):
            """Stay able to brake before z = 300 m."""

            fault: str = ""

            def evaluate(self, state):
                height, speed = state.position[:, 2], state.velocity[:, 2]
                gradient = np.zeros((len(state), 6))
                gradient[:, 2], gradient[:, 5] = -1.0, -np.abs(speed) / 0.08
                h = 300.0 - height - speed * np.abs(speed) / 0.16
                return ConstraintValues(300.0 - height, h, gradient, np.zeros(len(state)))

            @staticmethod
            def half_space(p, x, d):
                d[2] = p[0]
                return p[1]

            def half_space_parameters(self):
                numbers = {
                    "wrong sign": (1.0, 300.0),
                    "NaN": (np.nan, -300.0),
                    "zero": (0.0, -300.0),
                    "infinite need": (-1.0, np.inf),
                    "too far": (-1.0, -250.0),
                    "too near": (-1.0, -350.0),
                }
                return numbers.get(self.fault, (-1.0, -300.0))

        found = breaches(Ceiling(fault=fault))
        found.pop("documented")  # the field of the test
        assert set(found) == ({"half_space"} if fault else set())
        assert words in found.get("half_space", "")

    @pytest.mark.parametrize("error", [0.0, -10.0, -0.1, 0.1, 5.0])
    @pytest.mark.parametrize(("distance", "radius"), [(70.0, 20.0), (1500.0, 3.0)])
    def test_the_half_space_of_a_small_ball_far_from_the_chief(self, distance: float, radius: float, error: float):
        """Few samples are near such a ball, if any, and an error of a decimetre is found all the same."""

        class Ball(Constraint):
            """Stay able to stop before a ball on the y axis."""

            distance: float = 70.0
            radius: float = 20.0
            error: float = 0.0

            def evaluate(self, state):
                out, away = ConstraintValues.zeros(len(state)), state.position - [0.0, self.distance, 0.0]
                size = np.linalg.norm(away, axis=1)
                out.phi[:], unit = size - self.radius, away / size[:, None]
                closing = (unit * state.velocity).sum(axis=1)
                out.h[:] = out.phi + 50.0 * closing
                out.gradient[:, :3] = unit + 50.0 * (state.velocity - closing[:, None] * unit) / size[:, None]
                out.gradient[:, 3:] = 50.0 * unit
                return out

            @staticmethod
            def half_space(p, x, d):
                y = x[1] - p[0]
                size = np.sqrt(x[0] * x[0] + y * y + x[2] * x[2])
                d[0], d[1], d[2] = x[0] / size, y / size, x[2] / size
                return p[1] + d[1] * p[0]

            def half_space_parameters(self):
                return self.distance, self.radius + self.error

        found = breaches(Ball(distance=distance, radius=radius, error=error))
        words = "a state with phi > 0 is not within" if error > 0.0 else "a state with phi < 0 lies within it"
        assert words in found["half_space"] if error else "half_space" not in found

    def test_a_constraint_upon_which_no_thrust_acts(self) -> None:
        class Slab(Constraint):
            """Stay below z = 300 m, whatever the velocity: h = 300 m - z."""

            def evaluate(self, state):
                h = 300.0 - state.position[:, 2]
                gradient = np.tile([0.0, 0.0, -1.0, 0.0, 0.0, 0.0], (len(state), 1))
                return ConstraintValues(h, h, gradient, np.zeros(len(state)))

        class RoughSlab(Constraint):
            """A h too rough for any gradient to be compared with."""

            def evaluate(self, state):
                h = np.sin(1e9 * state.position[:, 2] * state.velocity[:, 2])
                gradient = np.tile([0.0, 0.0, 1.0, 0.0, 0.0, 1.0], (len(state), 1))
                return ConstraintValues(h, h, gradient, np.zeros(len(state)))

        assert set(breaches(Slab)) == {"thrust"}
        assert "velocity part of the gradient" in breaches(Slab)["thrust"]
        assert "h has no derivative" in breaches(RoughSlab)["gradient"]


def test_a_defined_plugin_is_registered() -> None:
    class PassingReward(Reward):
        """Pay 1."""

        def __call__(self, step):
            return np.ones(len(step.control))

    assert registry.get("reward", "PassingReward") is PassingReward


def test_bad_plugins_of_other_tests_are_gone() -> None:
    names = {name for kind in registry.kinds() for name, _ in registry.items(kind)}
    assert not names & {"PassingReward", "BadReward", "GoodReward", "CountingReward"}


def test_every_breach_is_told_at_once() -> None:
    class WorstReward(Reward):
        model_config = ConfigDict(frozen=False)

        scale: float = 1.0

        def __call__(self, step):
            step.control[:] = 0.0
            return np.zeros(len(step.control))

    assert set(breaches(WorstReward)) >= {"frozen", "documented", "inputs unchanged"}
