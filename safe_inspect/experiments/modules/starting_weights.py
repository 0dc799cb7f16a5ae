"""`starting_weights`: the weights with which a policy begins, from one that sees less or sees it otherwise."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from safe_inspect.errors import CheckpointError
from safe_inspect.evaluation.policy_files.policy_file import PolicyInfo
from safe_inspect.evaluation.policy_files.raw_values import ObservedElement
from safe_inspect.evaluation.policy_files.trained_layout import difference_of
from safe_inspect.experiments.modules.weights_file import info_of, initial_weights
from safe_inspect.types import AnyArray

#: How the weights of a net's first layer end; those of its bias end in "bias".
_FIRST = ".net.mlp.0.weight"


def starting_weights(source: str, model: Mapping[str, object]) -> Mapping[str, AnyArray]:
    """Return the weights of a policy for another one, which then does at first what that one does.

    Elements of the observation are told apart by their names. Where their normalisation differs, the first layers are
    converted exactly; elements that the other policy does not see get weights of zero.

    Args:
        source: Folder of a checkpoint with one policy, or the name of a policy that the package ships.
        model: RLlib's `model_config` of the new policy; as they are the weights come where it names no layout.

    Raises:
        CheckpointError: The weights cannot be read, the new policy lacks what the other one sees, or it acts otherwise.
    """
    weights = initial_weights(source)
    theirs, mine = weights.info, info_of(model)
    if theirs is None or mine is None:
        return weights.arrays
    difference = difference_of(theirs.action, mine.action)
    if difference:
        raise CheckpointError(f"{source}: its weights do not fit this policy: of the actions, {difference}")
    if theirs.observation == mine.observation:
        return weights.arrays
    places, gains, shifts = _converted(source, theirs, mine)
    arrays = dict(weights.arrays)
    for name in [name for name in arrays if name.startswith("encoder.") and name.endswith(_FIRST)]:
        layer, bias = arrays[name], f"{name.removesuffix('weight')}bias"
        wide = np.zeros((len(layer), len(mine.observation)), layer.dtype)
        wide[:, places] = layer * gains
        arrays[name] = wide
        arrays[bias] = (arrays[bias] + layer @ shifts).astype(layer.dtype)
    return arrays


def _converted(source: str, theirs: PolicyInfo, mine: PolicyInfo) -> tuple[list[int], AnyArray, AnyArray]:
    """Return where the elements of a policy stand in another one, and gains g and shifts s: theirs = g mine + s."""
    known = {key: place for place, key in enumerate(_keys(mine.observation))}
    places = []
    for key, element in zip(_keys(theirs.observation), theirs.observation, strict=True):
        found = known.get(key)
        if found is None or set(mine.observation[found].plugins) != set(element.plugins):
            raise CheckpointError(
                f"{source}: its weights do not fit this policy, which does not see {element} as that one does; observe "
                "it too, or begin with another policy"
            )
        places.append(found)
    seen = [mine.observation[place] for place in places]
    width = np.array([element.width for element in theirs.observation])
    gains = np.array([element.width for element in seen]) / width
    shifts = np.array([new.centre - old.centre for new, old in zip(seen, theirs.observation, strict=True)]) / width
    return places, gains, shifts


def _keys(elements: Sequence[ObservedElement]) -> list[tuple[str, str, int]]:
    """Return name, unit and number of occurrence of each element."""
    counts: Counter[str] = Counter()
    keys = []
    for element in elements:
        keys.append((element.name, element.unit.strip("-"), counts[element.name]))
        counts[element.name] += 1
    return keys
