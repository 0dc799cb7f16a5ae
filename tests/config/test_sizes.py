"""The limit on the number of values that a configuration may expand to."""

from __future__ import annotations

import pytest

from safe_inspect.config.loading.loader import MAX_VALUES, load
from safe_inspect.errors import ConfigError

#: A list of 1,998 numbers, which counts as 1,999 values with itself, a hundred times; 99 more numbers; the mapping.
_LISTS = "\n".join([f"a: &a [{', '.join(['1'] * 1998)}]", *(f"a{index}: *a" for index in range(99))])
_NUMBERS = "\n".join(f"b{index}: 1" for index in range(99))
_REFUSED = r"has 2(\.02)?e\+05 values; at most 200,000 are allowed"


def test_numbers_lists_and_the_values_of_aliases_count_alike(write) -> None:
    assert MAX_VALUES == 100 * 1_999 + 99 + 1
    most = f"{_LISTS}\n{_NUMBERS}\n"
    write(
        {"most.yml": most, "number.yml": f"{most}c: 1\n", "list.yml": f"{most}c: []\n", "alias.yml": f"{most}c: *a\n"}
    )
    load("most.yml")
    for file in ("number.yml", "list.yml", "alias.yml"):
        with pytest.raises(ConfigError, match=_REFUSED + r".*use fewer aliases, or a template \(`count`\)"):
            load(file)


def test_what_is_included_counts_each_time(write) -> None:
    """A file of 20 lists of 4 numbers counts as 101 values, 1,900 or 2,000 times."""
    include = "!include ./part.yml"
    write(
        {
            "part.yml": f"[{', '.join(['*a'] * 20)}]\n".replace("*a", "&a [1, 1, 1, 1]", 1),
            "most.yml": "".join(f"x{index}: {include}\n" for index in range(1_900)),
            "more.yml": "".join(f"x{index}: {include}\n" for index in range(2_000)),
        }
    )
    load("most.yml")
    with pytest.raises(ConfigError, match=_REFUSED):
        load("more.yml")
