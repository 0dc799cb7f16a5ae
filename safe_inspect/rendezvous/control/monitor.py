"""Check whether the reference of a new estimate is still one that bound, tube and plan were made for."""

from __future__ import annotations

import numpy as np

from safe_inspect.rendezvous.bound.conformal import Bound
from safe_inspect.rendezvous.control.design import TubeDesign
from safe_inspect.rendezvous.control.tightening import TightenedLimits, TrackedReference
from safe_inspect.rendezvous.planner.query import Plan


def reference_problem(design: TubeDesign, plan: Plan, unrenewed: Bound, reference: TrackedReference, k: int = 0) -> str:
    """Return what is wrong with a reference from step k on; empty if nothing is.

    The reference must stay within the bound that holds for a propagated estimate without updates, and it must leave
    the force, speed and part of the keep-in box that the tube needs. Otherwise bound, tube and certificate have to be
    computed again, or a new plan made. Errors of attitude do not affect the clearance, which is defined in the target's
    axes.

    Args:
        design: The tube of the plan.
        plan: The plan that is being flown.
        unrenewed: The bound of the plan's reference without updates.
        reference: The new reference, at the samples of the plan and possibly after them.
        k: The first step to check.
    """
    last = len(plan.times)
    for name, unit, found, planned, allowed in (
        ("position", "m", reference.position, plan.position, unrenewed.position),
        ("velocity", "m/s", reference.velocity, plan.velocity, unrenewed.velocity),
    ):
        difference = np.abs(found[k:last] - planned[k:]).max(axis=1, initial=0.0)
        excess = difference - allowed[k:]
        if excess.size and excess.max() > 0.0:
            worst = int(excess.argmax())
            return (
                f"reference: its {name} differs from the plan's by {difference[worst]:.3f} {unit} at "
                f"{plan.times[k + worst] - plan.t_start:.1f} s, more than the bound of {allowed[k + worst]:.3f} {unit}"
            )
    reserve = TightenedLimits(design.axis, reference, design.tube, design.limits).reserve(k).min(axis=0)
    for name, unit, value in zip(("keep-in box", "speed", "force"), ("m", "m/s", "N"), reserve, strict=True):
        if value < 0.0:
            return f"reference: together with its tube it exceeds the {name} limit by {-value:.3f} {unit}"
    return ""
