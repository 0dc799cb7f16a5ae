"""Write the names of the keys of RLlib's algorithms in the installed Ray, see `keys_of_release`.

python scripts/rllib_keys.py
"""

from __future__ import annotations

import json

from safe_inspect.config.keys.rllib_keys import ALGORITHMS, RELEASE
from safe_inspect.experiments.learning.algorithm import ATTRIBUTES, attribute_names, default_config


def names_of_release() -> dict[str, list[str]]:
    """Return the names that each algorithm has in addition to those that every algorithm has."""
    given = {attribute: name for name, attribute in ATTRIBUTES.items()}
    names = {
        algorithm: {given.get(name, name) for name in attribute_names(default_config(algorithm))}
        for algorithm in ALGORITHMS
    }
    common = set.intersection(*names.values())
    return {algorithm: sorted(found - common) for algorithm, found in names.items()}


if __name__ == "__main__":
    RELEASE.write_text(json.dumps(names_of_release(), indent=1) + "\n", encoding="utf-8")
