"""Templates: one entry with a `count` defines several equal agents; ``#`` in a name is replaced by the number of each.

    agent_config:
      - {name: "blue#_ctrl", count: 3, platforms: ["blue#"], config: ..., policy: ...}

defines ``blue0_ctrl`` on ``blue0``, ``blue1_ctrl`` on ``blue1`` and ``blue2_ctrl`` on ``blue2``. An entry of
`platform_config` with ``#`` in its name defines all platforms that such agents control.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from safe_inspect.config.loading.located import REPLACED, LocatedDict, Place, locate, rewritten, with_marks
from safe_inspect.errors import Problem, did_you_mean

#: Placeholder of the number in a name.
PLACEHOLDER = "#"
#: The largest number of deputies in one environment.
MAX_COUNT = 100


def expand_templates(tree: LocatedDict, problems: list[Problem]) -> LocatedDict:
    """Return the experiment with all templates expanded.

    Args:
        tree: A loaded experiment; it is not changed.
        problems: List to which mistakes are added.
    """
    agents, platforms = tree.get("agent_config"), tree.get("platform_config")
    if not isinstance(agents, list) or not isinstance(platforms, list):
        return tree
    counts: dict[str, int] = {}
    root, expanded = Place(tree, problems), tree.copy()
    for key, entries, write in (("agent_config", agents, _agent), ("platform_config", platforms, _platform)):
        written = [
            (copy, locate(entries, (index,)))
            for index, entry in enumerate(entries)
            for copy in write(entry, root.at(key, index), counts)
        ]
        expanded[key] = with_marks(written, getattr(entries, "location", None))
        replaced = getattr(entries, "marks", {}).get(REPLACED)
        if replaced is not None:
            expanded[key].marks[REPLACED] = replaced
    return expanded


def _agent(entry: Any, place: Place, counts: dict[str, int]) -> Iterator[Any]:
    if not isinstance(entry, dict) or ("count" not in entry and PLACEHOLDER not in str(entry.get("name"))):
        yield entry
        return
    count = entry.get("count", 1)
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MAX_COUNT:
        place.report(f"expected a whole number from 1 to {MAX_COUNT}, got {count!r}", "count")
        count = 1
    platforms = entry.get("platforms")
    names = [entry.get("name"), *(platforms if isinstance(platforms, list) else ())]
    if count > 1 and not all(isinstance(name, str) and PLACEHOLDER in name for name in names):
        text = f"{count} agents need unique names and platforms; write `{PLACEHOLDER}` for the number in them"
        place.report(text, "count")
        count = 1
    for name in names[1:]:
        if isinstance(name, str) and PLACEHOLDER in name:
            counts[name] = max(counts.get(name, 0), count)
    for number in range(count):
        copy = _numbered(entry, number)
        copy.pop("count", None)
        if isinstance(platforms, list):
            numbered = [str(name).replace(PLACEHOLDER, str(number)) for name in platforms]
            copy["platforms"] = rewritten(platforms, numbered)
        yield copy


def _platform(entry: Any, place: Place, counts: dict[str, int]) -> Iterator[Any]:
    name = entry.get("name") if isinstance(entry, dict) else None
    if not isinstance(name, str) or PLACEHOLDER not in name:
        yield entry
        return
    if name not in counts:
        hint = f"name it under `platforms` of an agent with `{PLACEHOLDER}` in its name"
        hint = did_you_mean(name, counts) if counts else hint
        place.report(f"no agent controls the platforms {name!r}", "name", hint=hint)
    for number in range(counts.get(name, 1)):
        yield _numbered(entry, number)


def _numbered(entry: dict[Any, Any], number: int) -> LocatedDict:
    copy: LocatedDict = rewritten(entry)
    if isinstance(copy.get("name"), str):
        copy["name"] = copy["name"].replace(PLACEHOLDER, str(number))
    return copy
