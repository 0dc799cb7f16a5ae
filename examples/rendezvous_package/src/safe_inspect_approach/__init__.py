"""Plugins of a rendezvous for safe_inspect: a planner and a tracker. Importing the package registers them."""

from safe_inspect_approach.planner import DirectPlanner
from safe_inspect_approach.tracker import ProportionalDerivativeTracker

__all__ = ["DirectPlanner", "ProportionalDerivativeTracker"]
