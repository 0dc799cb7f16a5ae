"""Leaderboards: policies, baselines and published figures of a task, side by side in Markdown."""
