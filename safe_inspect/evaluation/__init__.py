"""Evaluation: rollouts, baselines and summaries."""

from safe_inspect.evaluation.policies import BASELINES, Flight, Policy, baseline, with_scripted
from safe_inspect.evaluation.results.episodes import AgentEpisodes, Episodes
from safe_inspect.evaluation.results.summary import AgentSummary, Statistic, Summary, summarise
from safe_inspect.evaluation.rollouts.rollout import rollout
from safe_inspect.evaluation.rollouts.trajectory import Trajectory

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
