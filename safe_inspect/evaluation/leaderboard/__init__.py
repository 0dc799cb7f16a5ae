"""Leaderboards: Markdown tables of policies, baselines and published figures of a task."""
