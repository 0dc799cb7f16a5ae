"""Evaluation: rollouts, baselines and tables."""

from safe_inspect.evaluation.episodes import AgentEpisodes, Episodes
from safe_inspect.evaluation.policies import BASELINES, Flight, Policy, baseline, with_scripted
from safe_inspect.evaluation.recorder import Trajectory
from safe_inspect.evaluation.results.results import Evaluation
from safe_inspect.evaluation.results.tables import evaluation_table
from safe_inspect.evaluation.rollouts import rollout

__all__ = [
    "BASELINES",
    "AgentEpisodes",
    "Episodes",
    "Evaluation",
    "Flight",
    "Policy",
    "Trajectory",
    "baseline",
    "evaluation_table",
    "rollout",
    "with_scripted",
]
