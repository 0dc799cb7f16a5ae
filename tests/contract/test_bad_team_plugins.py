"""The test kit finds what is wrong with several deputies: groups of agents, shared dones, pilots, teams' filters."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest

from safe_inspect.dones import SharedDoneFunction
from safe_inspect.platforms import Sensor
from safe_inspect.policies import SCRIPTED_POLICY, ScriptedPolicy
from safe_inspect.rewards import Reward
from safe_inspect.rta.base import TeamFiltered, TeamSafety
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.testing import check_plugin

from .reports import breaches

pytestmark = pytest.mark.usefixtures("clean_registry")


class TestGroups:
    def test_rows_of_environments_alone(self) -> None:
        class FirstReward(Reward):
            """Pay for the sun's angle, as the state has it."""

            def __call__(self, step):
                return step.after.state.sun_angle.copy()

        assert "(48,) for 144 rows" in breaches(FirstReward)["shape"]

    def test_agents_in_the_wrong_order(self) -> None:
        class MixedReward(Reward):
            """Pay the height, agent by agent instead of environment by environment."""

            def __call__(self, step):
                group = step.after.group
                return step.after.state.position[:, group.first : group.first + group.size, 2].T.reshape(-1)

        class LeaderSensor(Sensor, name="Sensor_Leader"):
            """Height of the group's first deputy instead of the own [m]."""

            elements: ClassVar[tuple[str, ...]] = ("z",)
            symbol: ClassVar[str] = "m"

            def __call__(self, view):
                return view.per_environment(view.state.position[:, view.group.first, 2:])

        assert "row-wise" in breaches(MixedReward)
        found = breaches(LeaderSensor)
        assert set(found) == {"agents"}
        assert "agent 1 of the group" in found["agents"]


class TestSharedDone:
    def test_a_good_one(self) -> None:
        class LateDone(SharedDoneFunction):
            """Draw after 5 steps."""

            def __call__(self, step):
                return np.where(step.after.step > 5, 3, 0).astype(np.int8)

        check_plugin(LateDone)

    def test_what_it_returns(self) -> None:
        class MaskDone(SharedDoneFunction):
            """Every agent's own height, as a mask."""

            def __call__(self, step):
                return step.after.position[..., 2] > 0.0

        class OtherDone(SharedDoneFunction):
            """A status that there is not."""

            def __call__(self, step):
                return np.where(step.after.position[:, 0, 2] > 0.0, np.int8(7), np.int8(0))

        class GreedyDone(SharedDoneFunction):
            """Any agent's win, and all agents forget their ends."""

            def __call__(self, step):
                won = (step.status == 1).any(axis=1)
                step.status[:] = 0
                return won.astype(np.int8)

        assert {"shape"} == set(breaches(MaskDone))
        assert "[7]" in breaches(OtherDone)["status"]
        assert "step.status" in breaches(GreedyDone)["inputs unchanged"]


class TestPolicy:
    def test_a_good_one_that_remembers(self) -> None:
        class RampPolicy(ScriptedPolicy):
            """More thrust along z with every step of the deputy."""

            def memory(self, world):
                return {"steps": ArraySpec((), np.int64)}

            def __call__(self, view, limits):
                steps = view.memory(SCRIPTED_POLICY, "steps")
                steps += 1
                thrust = np.zeros((view.num_rows, 3))
                thrust[:, 2] = np.minimum(0.05 * steps * (1 + view.own_index), limits.high[2])
                return thrust

        check_plugin(RampPolicy)

    def test_what_it_does_wrong(self) -> None:
        class FlatPolicy(ScriptedPolicy):
            """Thrust along x alone."""

            def __call__(self, view, limits):
                return np.full(view.num_rows, limits.high[0])

        class ForgetfulPolicy(ScriptedPolicy):
            """Thrust that depends on a separate counter."""

            def __call__(self, view, limits):
                calls = self.__dict__.setdefault("calls", [])
                calls.append(1)
                return np.full((view.num_rows, 3), 1.0 / len(calls))

        class MeddlingPolicy(ScriptedPolicy):
            """No thrust, and a reset clock."""

            def __call__(self, view, limits):
                view.state.time[:] = -1.0
                return np.zeros((view.num_rows, 3))

        class CrowdPolicy(ScriptedPolicy):
            """Remember the number of rows and thrust by it later."""

            def memory(self, world):
                return {"rows": ArraySpec((), np.float64)}

            def __call__(self, view, limits):
                rows = view.memory(SCRIPTED_POLICY, "rows")
                thrust = np.stack([rows / 100.0] * 3, axis=-1)
                rows[:] = view.num_rows
                return thrust

        assert "expected shape (8, 3)" in breaches(FlatPolicy)["runs"]
        assert set(breaches(ForgetfulPolicy)) >= {"no memory"}
        assert "view.state.time[:] = -1.0" in breaches(MeddlingPolicy)["inputs unchanged"]
        assert "alone than in a batch" in breaches(CrowdPolicy)["row-wise"]


class _Tame:
    """What the filters below share: they refuse nothing."""

    def refusals(self, states):
        return {"none": np.zeros(len(states["sun_angle"]), dtype=np.bool_)}

    def safety(self, states):
        return {"none": np.ones(len(states["sun_angle"]))}


def halved(desired, **changes: Any) -> TeamFiltered:
    control = 0.5 * desired
    intervening = ((control - desired) ** 2).sum(axis=-1) > 1e-4
    nobody = np.zeros(len(desired), dtype=np.bool_)
    return TeamFiltered(**{"control": control, "intervening": intervening, "infeasible": nobody, "backup": nobody,
                           **changes})  # fmt: skip


class TestTeamSafety:
    def test_a_good_one(self) -> None:
        class HalfSafety(_Tame, TeamSafety):
            """Give half the desired thrust, and count the steps."""

            def memory(self, world):
                return {"steps": ArraySpec((), np.int64)}

            def __call__(self, desired, team):
                return halved(desired, memory={"steps": team.memory("steps") + 1})

        check_plugin(HalfSafety)
        check_plugin(HalfSafety(enabled=False))

    def test_what_it_does_wrong(self) -> None:
        class QuietSafety(_Tame, TeamSafety):
            """Give half the desired thrust without a word."""

            def __call__(self, desired, team):
                return halved(desired, intervening=np.zeros(desired.shape[:2], dtype=np.bool_))

        class SecretSafety(_Tame, TeamSafety):
            """Remember what is not declared."""

            def __call__(self, desired, team):
                return halved(desired, memory={"thrust": desired.copy()})

        class MeanSafety(_Tame, TeamSafety):
            """Give the thrust about that of all environments."""

            def __call__(self, desired, team):
                control = desired - desired.mean(axis=0)
                moved = ((control - desired) ** 2).sum(axis=-1) > 1e-4
                return halved(desired, control=control, intervening=moved)

        class PairSafety(_Tame, TeamSafety):
            """Tell refusals of each deputy instead of each team."""

            def __call__(self, desired, team):
                return halved(desired)

            def refusals(self, states):
                return {"low": states["position"][..., 2] < 0.0}

        assert "deputies" in breaches(QuietSafety)["intervening"]
        assert "['thrust']" in breaches(SecretSafety)["memory"]
        assert "row-wise" in breaches(MeanSafety)
        assert "(R,) for each constraint" in breaches(PairSafety)["shape"]
