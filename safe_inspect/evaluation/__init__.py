"""Evaluation: rollouts, baselines and summaries."""

from safe_inspect.evaluation.episodes import AgentEpisodes, Episodes
from safe_inspect.evaluation.policies import BASELINES, Flight, Policy, baseline, with_scripted
from safe_inspect.evaluation.rollout import rollout
from safe_inspect.evaluation.summary import AgentSummary, Statistic, Summary, summarise
from safe_inspect.evaluation.trajectory import Trajectory

__all__ = [
    "BASELINES",
    "AgentEpisodes",
    "AgentSummary",
    "Episodes",
    "Flight",
    "Policy",
    "Statistic",
    "Summary",
    "Trajectory",
    "baseline",
    "rollout",
    "summarise",
    "with_scripted",
]
