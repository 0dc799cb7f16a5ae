"""An estimator, a planner and a tracker of a rendezvous for safe_inspect. Importing the package registers them."""

from safe_inspect_approach.estimator import FixedGainEstimator
from safe_inspect_approach.planner import DirectPlanner
from safe_inspect_approach.tracker import ProportionalDerivativeTracker

__all__ = ["DirectPlanner", "FixedGainEstimator", "ProportionalDerivativeTracker"]
