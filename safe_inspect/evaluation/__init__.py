"""Evaluation: rollouts, baselines, summaries and figures. Matplotlib is imported when a figure is drawn."""

from safe_inspect.evaluation.policies import BASELINES, Flight, Policy, baseline, random_policy, zero_thrust
from safe_inspect.evaluation.rollout import rollout
from safe_inspect.evaluation.summary import Statistic, Summary, summarise
from safe_inspect.evaluation.trajectory import Episodes, Trajectory

__all__ = [
    "BASELINES",
    "Episodes",
    "Flight",
    "Policy",
    "Statistic",
    "Summary",
    "Trajectory",
    "baseline",
    "random_policy",
    "rollout",
    "summarise",
    "zero_thrust",
]
