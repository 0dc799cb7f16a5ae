"""The suggestions for names that a task does not provide."""

from __future__ import annotations

from safe_inspect.simulators.offers import missing


def test_a_name_that_every_task_provides_is_suggested_but_not_listed() -> None:
    class View:
        position = 0.0

    error = missing("view", "positions", ["points"], View())
    assert str(error) == "the view of this task has no 'positions'; did you mean `position`?"
    assert str(missing("view", "target", ["points"], View())).endswith("no 'target'; known: `points`")
    assert str(missing("view", "target", [], View())).endswith("no 'target'; there is none")
