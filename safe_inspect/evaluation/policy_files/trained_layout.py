"""`check_layout`: checks that a task's observation and action are those with which a policy was trained.

Checkpoints, ONNX files, frozen policies and exports use this one comparison. It compares the elements from the policy's
point of view: names and units, how the normalisers transform a reading, what a command means and where it is clipped.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from safe_inspect.config.spec import AgentSpec
from safe_inspect.errors import CheckpointError
from safe_inspect.evaluation.policy_files.policy_file import PolicyInfo
from safe_inspect.evaluation.policy_files.raw_values import (
    CommandedElement,
    ObservedElement,
    commanded_elements,
    observed_elements,
)

TrainedElement = ObservedElement | CommandedElement

# A number that was converted from another unit differs in its last bits.
_RELATIVE, _ABSOLUTE = 1e-9, 1e-12


def check_layout(title: str, trained: PolicyInfo, agent: AgentSpec) -> None:
    """Raise an error for an agent whose observation or action differs from that of the policy's training.

    Args:
        title: Where the policy is stored, for the message.
        trained: The metadata of the policy.
        agent: The agent that the policy is to control.

    Raises:
        CheckpointError: They differ; the message names the first difference.
    """
    for what, theirs, mine in (
        ("observation", trained.observation, observed_elements(agent, exportable=False)),
        ("action", trained.action, commanded_elements(agent, exportable=False)),
    ):
        difference = difference_of(theirs, mine)
        if difference:
            raise CheckpointError(
                f"{title}: the policy is of another task ({trained.task}): in the {what} of {agent.name}, "
                f"{difference}; use the glues and controllers of its training (without --cfg and overrides a policy "
                "flies the task of its training), or train a policy for this task"
            )


def difference_of(trained: Sequence[TrainedElement], task: Sequence[TrainedElement]) -> str:
    """Return the first difference between the elements of training and those of a task; empty if there is none."""
    for index, (old, new) in enumerate(zip(trained, task, strict=False)):
        if (old.name, old.unit.strip("-")) != (
            new.name,
            new.unit.strip("-"),
        ):  # "" and "-" both mean that there is no unit
            return f"element {index} is {old} in training and {new} in the task"
    if len(trained) != len(task):
        return f"there are {len(trained)} elements in training and {len(task)} in the task"
    for old, new in zip(trained, task, strict=True):
        if _axis(old) and _axis(old) != _axis(new):  # files of early versions name no axis
            return f"{old.name} acts along {_axis(old)} in training and along {_axis(new) or 'no axis'} in the task"
        mine, theirs = _numbers(old), _numbers(new)
        if _chooses(old) != _chooses(new) or len(mine) != len(theirs) or not _close(mine, theirs):
            return f"{old.name} {_meaning(old)} in training and {_meaning(new)} in the task"
        if bool(old.plugins) != bool(new.plugins) or not set(new.plugins) <= set(old.plugins):
            return f"{old.name} comes from {_short(old)} in training and from {_short(new)} in the task"
    return ""


def _axis(element: TrainedElement) -> str:
    return element.axis if isinstance(element, CommandedElement) else ""


def _chooses(element: TrainedElement) -> bool:
    return isinstance(element, CommandedElement) and bool(element.levels)


def _close(mine: tuple[float, ...], theirs: tuple[float, ...]) -> bool:
    return bool(np.allclose(mine, theirs, rtol=_RELATIVE, atol=_ABSOLUTE))


def _numbers(element: TrainedElement) -> tuple[float, ...]:
    if isinstance(element, ObservedElement):
        return element.centre, element.width
    return element.levels or (element.low, element.high, element.gain, element.offset)


def _meaning(element: TrainedElement) -> str:
    if isinstance(element, ObservedElement):
        return f"is seen as (value - {element.centre:.10g}) / {element.width:.10g}"
    if element.levels:
        return f"has the levels [{', '.join(f'{level:.10g}' for level in element.levels)}] {element.unit}"
    limits = f"[{element.low:.10g}, {element.high:.10g}] {element.unit or '-'}"
    return f"commands {element.offset:.10g} + {element.gain:.10g} a within {limits}"


def _short(element: TrainedElement) -> str:
    text = " or ".join(element.plugins) or "this package's plugins"
    return text if len(text) <= 200 else f"{text[:197]}..."
