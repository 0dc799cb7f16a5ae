"""Whether a new estimate's reference is still the one that bound, tube and plan were made for."""

from __future__ import annotations

import numpy as np

from safe_inspect.rendezvous.bound.conformal import Bound
from safe_inspect.rendezvous.control.design import TubeDesign
from safe_inspect.rendezvous.control.tightening import TightenedLimits, TrackedReference
from safe_inspect.rendezvous.planner.query import Plan


def reference_problem(design: TubeDesign, plan: Plan, unrenewed: Bound, reference: TrackedReference, k: int = 0) -> str:
    """Return what is wrong with a reference from step k on; empty where nothing is.

    It is to stay within the bound that a propagated estimate keeps without updates, and it is to leave what the tube
    needs of force, speed and keep-in box. Otherwise bound, tube and certificate are to be made anew, or a new plan.
    Errors of attitude do not touch the clearance, which is kept in the target's axes.

    Args:
        design: The tube of the plan.
        plan: The plan that is flown.
        unrenewed: The bound of the plan's reference without updates.
        reference: The new reference, at the plan's samples and after.
        k: The first step that matters.
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
                f"{plan.times[k + worst] - plan.t_start:.1f} s, {allowed[k + worst]:.3f} {unit} are bounded"
            )
    reserve = TightenedLimits(design.axis, reference, design.tube, design.limits).reserve(k).min(axis=0)
    for name, unit, value in zip(("keep-in box", "speed", "force"), ("m", "m/s", "N"), reserve, strict=True):
        if value < 0.0:
            return f"reference: with its tube it exceeds the limit of {name} by {-value:.3f} {unit}"
    return ""
