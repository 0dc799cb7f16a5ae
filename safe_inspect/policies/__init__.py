"""Scripted policies: what flies a deputy without training. Importing it registers them."""

from safe_inspect.policies.base import PILOT, ScriptedPolicy, ThrustLimits

__all__ = ["PILOT", "ScriptedPolicy", "ThrustLimits"]
