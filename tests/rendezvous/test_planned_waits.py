"""The waits and the durations among which a plan of the approach is chosen."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from safe_inspect.rendezvous.coordination import actions


@pytest.mark.parametrize(
    ("failures", "plan", "waits", "durations"),
    [(0, None, (0.0, 2.0, 4.0, 6.0), (60.0,)), (1, None, (0.0, 2.0, 4.0, 6.0), (60.0, 90.0))],
)
def test_the_waits_cover_the_limit_in_steps(monkeypatch, failures, plan, waits, durations) -> None:
    asked: list[tuple[Any, ...]] = []
    monkeypatch.setattr(actions, "_plan", lambda _, *given: asked.append(given))
    mission = SimpleNamespace(wait_limit=6.0, wait_step=2.0, durations=(60.0, 90.0))
    context: Any = SimpleNamespace(
        config=SimpleNamespace(mission=mission), plan_failures=failures, bound_failures=0, plan=plan, on_approach=False
    )
    actions.make_plan(context)
    actions.make_plan_again(context)
    assert asked == [(waits, durations)] * 2


@pytest.mark.parametrize("plan", [None, SimpleNamespace(duration=75.0)])
def test_on_the_approach_there_is_no_wait_and_the_duration_stays(monkeypatch, plan) -> None:
    asked: list[tuple[Any, ...]] = []
    monkeypatch.setattr(actions, "_plan", lambda _, *given: asked.append(given))
    mission = SimpleNamespace(wait_limit=6.0, wait_step=2.0, durations=(60.0, 90.0))
    context: Any = SimpleNamespace(
        config=SimpleNamespace(mission=mission), plan_failures=0, bound_failures=0, plan=plan, on_approach=True
    )
    actions.make_plan_again(context)
    assert asked == [((0.0,), (60.0,) if plan is None else (75.0,))]
