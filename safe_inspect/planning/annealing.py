"""Acceptance rule of simulated annealing, used by both plan searches."""

from __future__ import annotations

import math

from safe_inspect.compiling import njit


@njit
def accepted_cost(cost: float, temperature: float, done: float, uniform: float) -> float:
    """Return the cost up to which a changed plan is accepted: ``cost - temperature (1 - done) ln(uniform)``.

    Source: N. Metropolis et al., 1953; S. Kirkpatrick et al., "Optimization by Simulated Annealing", 1983, with a
    temperature that decreases linearly.

    Args:
        cost: Cost of the current plan.
        temperature: Initial temperature, in the unit of the cost.
        done: Completed share of the search, from 0 to 1.
        uniform: A random number in [0, 1).
    """
    return cost - temperature * (1.0 - done) * math.log(uniform + 1e-300)
