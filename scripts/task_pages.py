"""Write docs/task-reference.md: the observation, action, rewards, dones and results of every task, from the code.

python scripts/task_pages.py             # the page
python scripts/task_pages.py --pictures  # also docs/images/tasks/*.png: an episode of each task, a few minutes
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path

from PIL import Image

from safe_inspect.cli.main import main as safe_inspect_command
from safe_inspect.environments import load_spec
from safe_inspect.environments.layout import Layout, action_layout, observation_layout
from safe_inspect.plugins.functor import Named
from safe_inspect.task_ids import ALL_TASKS, TASK_OVERRIDES, TEAM_TASKS

_DOCS = Path(__file__).parents[1] / "docs"
PAGE = _DOCS / "task-reference.md"
_HEAD = """\
# Task reference

This page is generated from the configurations: `python scripts/task_pages.py`. [Tasks](tasks.md)
explains the tasks, and [Simulation](simulation.md) the physics. The agents of a team have equal observations
and actions; the table shows those of one agent.
"""
#: Policy that flies the episode of a task's picture: the shipped one, or a scripted one where none is shipped.
_PILOTS = {
    "TranslationalInspectionSeed-v0": "inspector",
    "TranslationalInspection-v1": "translational-inspection",
    "FilteredTranslationalInspection-v1": "translational-inspection",
    "WeightedTranslationalInspection-v0": "weighted-translational-inspection",
    "WeightedSixDofInspection-v0": "SixDofInspector",
    "Docking-v0": "DockingAutopilot",
    "TumblingRendezvous-v0": "tumbling-rendezvous",
    "MultiagentTranslationalInspectionSeed-v0": "inspector",
    "MultiagentTranslationalInspection-v1": "multiagent-translational-inspection",
    "MultiagentWeightedTranslationalInspection-v0": "multiagent-weighted-translational-inspection",
    "MultiagentWeightedSixDofInspection-v0": "SixDofInspector",
    "MultiagentDocking-v0": "DockingAutopilot",
}
_SEED = 1


def page() -> str:
    """Return the text of the page."""
    return "\n".join([_HEAD, *(f"{_task(name)}\n" for name in ALL_TASKS)]).rstrip() + "\n"


def _task(name: str) -> str:
    """Return the section of a task."""
    spec, short = load_spec(name), name.partition("/")[2]
    agent, make = spec.agents[0], "make_parallel" if name in TEAM_TASKS else "make"
    lines = [f"## {short}", "", f"`safe_inspect.{make}({name!r})`, from `configs/{ALL_TASKS[name]}`"]
    lines[-1] += "".join(f" with `{override}`" for override in TASK_OVERRIDES.get(name, ())) + "."
    lines += ["", f"![An episode of {short}, flown by {_PILOTS[short]}](images/tasks/{short}.png)"]
    lines += ["", f"Agents: {len(spec.agents)}. Control step: {spec.step_size:g} s."]
    for title, layout in (("observation", observation_layout(agent)), ("action", action_layout(agent))):
        lines += ["", f"| {title}, {layout.size} elements | range |", "|---|---|", *_rows(layout)]
    for title, terms in (("reward", agent.rewards), ("done", (*agent.dones, *spec.shared_dones))):
        lines += ["", f"| {title} | |", "|---|---|", *_terms(terms)]
    return "\n".join([*lines, *_results(name)])


def _rows(layout: Layout) -> Iterator[str]:
    """Yield a row for each reading or command: the names of its elements, and their range."""
    ranges = [f"[{low:g}, {high:g}]" for low, high in zip(layout.low, layout.high, strict=True)]
    if layout.choices:
        ranges = [f"one of {count}" for count in layout.choices]
    elements = [(*name.partition("."), text) for name, text in zip(layout.names, ranges, strict=True)]
    for (reading, text), members in groupby(elements, lambda element: (element[0], element[3])):
        names = ", ".join(f"`{element}`" for _, _, element, _ in members if element)
        yield f"| `{reading}`{': ' if names else ''}{names} | {text} |"


def _terms(terms: Iterable[Named]) -> Iterator[str]:
    """Yield a row for each reward or done: its name, and the first sentence of its docstring."""
    for named in terms:
        text = re.split(r"\n\n|(?<=[^.].)\.\s|; shape", (type(named.functor).__doc__ or "").strip())[0]
        yield f"| `{named.name}` | {' '.join(text.split()).rstrip('.:').replace('|', chr(92) + '|')} |"


def _results(name: str) -> list[str]:
    """Return the rows of the leaderboard for the task."""
    board = (_DOCS / "leaderboard.md").read_text(encoding="utf-8")
    over = [f"`{override}`" for override in TASK_OVERRIDES.get(name, ())]
    task = f"Task: `configs/{ALL_TASKS[name]}`" + (f", with {', '.join(over)}." if over else ".")
    table = board.partition(f"{task}\n\n")[2].partition("\n\n")[0]
    return ["", "Results of 1,000 episodes ([leaderboard](leaderboard.md)):", "", table.rstrip()] if table else []


def draw_pictures() -> None:
    """Draw an episode of every task into docs/images/tasks."""
    folder = _DOCS / "images" / "tasks"
    folder.mkdir(exist_ok=True)
    for name in ALL_TASKS:
        short = name.partition("/")[2]
        picture = str(folder / f"{short}.png")
        code = safe_inspect_command(["draw", _PILOTS[short], "--cfg", name, "--seed", str(_SEED), "--output", picture])
        if code:
            sys.exit(code)
        Image.open(picture).convert("RGB").quantize(64).save(picture, optimize=True)  # a third of the size


if __name__ == "__main__":
    if "--pictures" in sys.argv[1:]:
        draw_pictures()
    PAGE.write_text(page(), encoding="utf-8")
