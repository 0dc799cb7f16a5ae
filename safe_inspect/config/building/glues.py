"""Checks that involve several glues of an agent."""

from __future__ import annotations

from collections.abc import Mapping

from safe_inspect.config.messages.report import KeyTuple, ReportProblem
from safe_inspect.errors import UnitError
from safe_inspect.glues.base import ActionGlue, Glue, ObservationGlue
from safe_inspect.glues.coast_glue import CoastGlue
from safe_inspect.platforms.base import Part


def check_glues(
    glues: tuple[Glue, ...], parts: Mapping[str, Part], where: KeyTuple, report: ReportProblem, *, observes: bool
) -> None:
    """Check that glues match the parts, command each controller once, and include observations and commands.

    Args:
        glues: The glues of an agent.
        parts: Its parts, by name.
        where: Path of the glues.
        report: Function that is called with the path and the message of every mistake.
        observes: Whether the agent's policy needs an observation.
    """
    commanded: set[str] = set()
    discrete: set[bool] = set()
    for index, glue in enumerate(glues):
        try:
            glue.bounds(parts)
        except (ValueError, UnitError) as error:
            report((*where, index), str(error))
            continue
        if isinstance(glue, ActionGlue):
            for name in glue.names(parts):
                if name in commanded:
                    report((*where, index), f"the controller {name!r} is commanded twice; remove one of the glues")
                commanded.add(name)
            discrete |= {
                bool(count)
                for leaf in glue.leaves()
                if not isinstance(leaf, CoastGlue)
                for count in leaf.choices(parts)
            }
    leaves = [leaf for glue in glues if isinstance(glue, ActionGlue) for leaf in glue.leaves()]
    if any(isinstance(leaf, CoastGlue) for leaf in leaves[:-1]):
        report(where, "CoastGlue is before the glue of a controller; move it to the end of the list")
    if len(discrete) > 1:
        report(where, "discrete and continuous action glues are mixed; use one kind for all of them")
    for base, what in ((ObservationGlue, "observes a sensor"), (ActionGlue, "commands a controller")):
        if not any(isinstance(glue, base) and glue.exported for glue in glues) and (observes or base is ActionGlue):
            report(where, f"there is no glue that {what}; add one")
