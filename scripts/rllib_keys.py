"""Write the names of the keys of RLlib's algorithms in the installed Ray, see `keys_of_release`.

python scripts/rllib_keys.py
"""

from __future__ import annotations

import json
from typing import Any

import ray

from safe_inspect.config.keys.rllib_keys import ALGORITHMS, RELEASE
from safe_inspect.experiments.learning.algorithm import ATTRIBUTES, attribute_names, default_config


def names_of_release() -> dict[str, Any]:
    """Return the release, the names that every algorithm has, and the additional names of each algorithm."""
    given = {attribute: name for name, attribute in ATTRIBUTES.items()}
    names = {
        algorithm: {given.get(name, name) for name in attribute_names(default_config(algorithm))}
        for algorithm in ALGORITHMS
    }
    common = set.intersection(*names.values())
    own = {algorithm: sorted(found - common) for algorithm, found in names.items()}
    return {"ray": ray.__version__, "every algorithm": sorted(common), **own}


if __name__ == "__main__":
    RELEASE.write_text(json.dumps(names_of_release(), indent=1) + "\n", encoding="utf-8")
