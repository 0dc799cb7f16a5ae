"""Shared done functions, on teams made by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safe_inspect.dones import DoneStatus, SharedDoneFunction
from safe_inspect.dones.shared import CollisionDoneFunction, MultiagentSuccessDoneFunction, SetAllDoneFunction
from safe_inspect.dynamics import Dynamics
from safe_inspect.plugins.functor import build
from safe_inspect.simulators.state import State, base_specs
from safe_inspect.simulators.team import TeamStep, TeamView
from safe_inspect.simulators.world import World

RUNNING, WIN, LOSE, DRAW = DoneStatus
SUCCESS = "SuccessfulInspectionDoneFunction"


def team(position, status=None, before=None, fired=None, has=None) -> TeamStep:
    """Return a step that ends with deputies at positions (N, D, 3) [m]; of three agents that won if they fired."""
    position = np.asarray(position, dtype=np.float64)
    rows, deputies, _ = position.shape
    names = tuple(f"blue{index}" for index in range(deputies))
    world = World(names, dict(zip(names, range(deputies), strict=True)), np.full(deputies, 12.0), 10.0)
    first, last = (State(rows, base_specs(deputies, deputies, 3, Dynamics.arrays)) for _ in range(2))
    last.position[:] = position
    first.finished[:] = 0 if before is None else before
    last.finished[:] = first.finished if status is None else status
    ended = np.zeros((rows, deputies), dtype=np.bool_) if fired is None else np.asarray(fired, dtype=np.bool_)
    with_it = np.ones(deputies, dtype=np.bool_) if has is None else np.asarray(has, dtype=np.bool_)
    views = TeamView(first, world), TeamView(last, world)
    return TeamStep(*views, fired={SUCCESS: ended}, status=last.finished, dt=10.0, has={SUCCESS: with_it})


def of_agents(status, before=None, fired=None, has=None) -> TeamStep:
    """Return a step of agents that end in the given ways, one row each."""
    status = np.asarray(status, dtype=np.int8)
    return team(np.zeros((*status.shape, 3)), status, before, fired, has)


def check(done: SharedDoneFunction, step: TeamStep, expected) -> None:
    found = done(step)
    assert found.dtype == np.int8
    assert found.tolist() == list(expected)


class TestCollision:
    def test_by_hand(self) -> None:
        apart = [[0, 0, 0], [10, 0, 0], [0, 0, 50]]
        near = [[0, 0, 0], [90, 0, 0], [84, 0, 7.5]]
        step = team([apart, near, apart], before=[[0, 0, 0], [0, WIN, LOSE], [0, 0, 0]])
        check(CollisionDoneFunction(), step, [RUNNING, LOSE, RUNNING])  # 10 m itself is allowed; the finished count
        check(CollisionDoneFunction(safety_constraint="10.001 m"), step, [LOSE] * 3)
        check(CollisionDoneFunction(safety_constraint=9.6), step, [RUNNING] * 3)

    def test_one_deputy_has_nobody_to_collide_with(self) -> None:
        check(CollisionDoneFunction(safety_constraint=1e6), team(np.zeros((2, 1, 3))), [RUNNING] * 2)

    @given(seed=st.integers(0, 2**32 - 1))
    @settings(max_examples=20, deadline=None)
    def test_every_pair_counts(self, seed: int) -> None:
        position = np.random.default_rng(seed).normal(0.0, 10.0, (6, 4, 3))
        distance = np.linalg.norm(position[:, :, None] - position[:, None], axis=-1) + 1e9 * np.eye(4)
        expected = np.where(distance.min(axis=(1, 2)) < 10.0, LOSE, RUNNING)
        check(CollisionDoneFunction(), team(position), expected)
        order = np.random.default_rng(seed).permutation(4)
        check(CollisionDoneFunction(), team(position[:, order]), expected)
        check(CollisionDoneFunction(), team(position[2:3]), expected[2:3])


class TestSuccess:
    done = MultiagentSuccessDoneFunction()

    def test_all_win_in_one_step(self) -> None:
        step = of_agents([[WIN, WIN, WIN], [WIN, WIN, RUNNING]], fired=[[1, 1, 1], [1, 1, 0]])
        check(self.done, step, [WIN, RUNNING])

    def test_one_after_the_other(self) -> None:
        before = [[WIN, RUNNING, WIN], [WIN, RUNNING, LOSE], [WIN, RUNNING, DRAW]]
        after = [[WIN, WIN, WIN], [WIN, WIN, LOSE], [WIN, WIN, DRAW]]
        check(self.done, of_agents(after, before, fired=[[0, 1, 0]] * 3), [WIN, RUNNING, RUNNING])

    def test_who_loses_in_the_same_step_has_not_won(self) -> None:
        check(self.done, of_agents([[WIN, LOSE]], fired=[[1, 1]]), [RUNNING])

    def test_agents_without_the_function_do_not_count(self) -> None:
        step = of_agents([[WIN, RUNNING], [RUNNING, WIN]], fired=[[1, 0], [0, 0]], has=[True, False])
        check(self.done, step, [WIN, RUNNING])
        check(self.done, of_agents([[WIN, WIN]], fired=[[0, 0]], has=[False, False]), [RUNNING])

    def test_a_function_that_no_agent_has_never_ends_an_episode(self) -> None:
        check(
            MultiagentSuccessDoneFunction(success_function_name="Other"), of_agents([[WIN], [RUNNING]]), [RUNNING] * 2
        )

    def test_the_name_is_a_reference(self) -> None:
        assert MultiagentSuccessDoneFunction.references() == {"success_function_name": "done"}


class TestSetAll:
    def test_the_worst_counts(self) -> None:
        step = of_agents([[0, 0, 0], [0, DRAW, 0], [WIN, DRAW, 0], [WIN, 0, LOSE], [0, WIN, 0]])
        check(SetAllDoneFunction(), step, [RUNNING, DRAW, WIN, LOSE, WIN])

    def test_of_some_endings(self) -> None:
        step = of_agents([[0, 0, 0], [0, DRAW, 0], [WIN, DRAW, 0], [WIN, 0, LOSE], [0, WIN, 0]])
        check(SetAllDoneFunction(statuses=["lose"]), step, [0, 0, 0, LOSE, 0])
        check(SetAllDoneFunction(statuses=["draw", "win"]), step, [0, DRAW, WIN, WIN, WIN])

    @pytest.mark.parametrize("statuses", [[], ["lost"], ["running"], "lose"])
    def test_endings_that_are_refused(self, statuses) -> None:
        with pytest.raises(ValueError, match="statuses"):
            SetAllDoneFunction(statuses=statuses)


@pytest.mark.parametrize("name", ["CollisionDoneFunction", "MultiagentSuccessDoneFunction"])
def test_the_names_of_safe_autonomy_sims(name: str) -> None:
    made = build("done", {"functor": f"safe_autonomy_sims.dones.common_dones.{name}"})
    assert type(made).__name__ == name
    assert isinstance(made, SharedDoneFunction)
