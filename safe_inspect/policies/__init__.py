"""Scripted policies: what flies a deputy without training. Importing it registers them."""

from safe_inspect.policies.base import PILOT, ScriptedPolicy, ThrustLimits
from safe_inspect.policies.blind import RandomThrust, ZeroThrust
from safe_inspect.policies.inspector import NaturalMotionInspector

__all__ = ["PILOT", "NaturalMotionInspector", "RandomThrust", "ScriptedPolicy", "ThrustLimits", "ZeroThrust"]
