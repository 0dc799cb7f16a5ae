"""Reward functors. Importing the package registers them."""

from safe_inspect.rewards import delta_v, docking, inspection, pointing, timely  # noqa: F401
from safe_inspect.rewards.base import Reward

__all__ = ["Reward"]
