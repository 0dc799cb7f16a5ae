"""Priors that replace a removed part of a graph."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from safe_inspect.rendezvous.back_end.factors import key
from safe_inspect.rendezvous.libraries import require

#: Letters of the variables that are poses, and of those that belong to a frame.
_POSES, _OF_FRAMES = "XGM", "XVBG"


def value_of(values: Any, letter: str, name: int) -> Any:
    """Return the value of a variable from a `gtsam.Values`; for the letters see `key`."""
    if letter in _POSES:
        return values.atPose3(name)
    getters = {"V": values.atVector, "B": values.atConstantBias}
    return getters.get(letter, values.atPoint3)(name)


def marginal_priors(solver: Any, values: Any, blocks: Sequence[tuple[str, int]]) -> list[tuple[tuple[int, ...], Any]]:
    """Return priors of variables from their marginals, each with the frames that it concerns.

    The covariances are multiplied by the number of variables: the independent priors are then never more certain than
    the joint marginal, for any correlation.

    Args:
        solver: The solver that computes the marginals, a `gtsam.ISAM2`.
        values: Its solution.
        blocks: Letter and number of each variable.
    """
    gtsam = require("gtsam")
    makers = {"V": gtsam.PriorFactorVector, "B": gtsam.PriorFactorConstantBias}
    priors: list[tuple[tuple[int, ...], Any]] = []
    for letter, index in blocks:
        name = key(letter, index)
        maker = gtsam.PriorFactorPose3 if letter in _POSES else makers.get(letter, gtsam.PriorFactorPoint3)
        covariance = len(blocks) * solver.marginalCovariance(name)
        noise = gtsam.noiseModel.Gaussian.Covariance(0.5 * (covariance + covariance.T))
        at = (index,) if letter in _OF_FRAMES else ()
        priors.append((at, maker(name, value_of(values, letter, name), noise)))
    return priors
