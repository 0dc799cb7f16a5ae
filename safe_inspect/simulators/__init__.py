"""Simulators: state, step, components, initialisers and reset parameters. Importing it registers their plugins."""

from safe_inspect.simulators.component import Component, PassiveComponent, RunningComponent
from safe_inspect.simulators.offers import OfView, OwnOfView
from safe_inspect.simulators.resets.attitudes import AttitudeParameter, CWHSixDOFRadialInitializer
from safe_inspect.simulators.resets.initializers import (
    CWH3DRadialWithSunInitializer,
    Initializer,
    PositionVelocityInitializer,
    RejectionSamplerInitializer,
)
from safe_inspect.simulators.resets.parameters import (
    ConstantParameter,
    Draw,
    Parameter,
    SimAttributeAccessor,
    TruncatedNormalParameter,
    UniformParameter,
)
from safe_inspect.simulators.simulator import ComposedSimulator, Simulator
from safe_inspect.simulators.state import State
from safe_inspect.simulators.view import Group, Step, View
from safe_inspect.simulators.world import World

__all__ = [
    "AttitudeParameter",
    "CWH3DRadialWithSunInitializer",
    "CWHSixDOFRadialInitializer",
    "Component",
    "ComposedSimulator",
    "ConstantParameter",
    "Draw",
    "Group",
    "Initializer",
    "OfView",
    "OwnOfView",
    "Parameter",
    "PassiveComponent",
    "PositionVelocityInitializer",
    "RejectionSamplerInitializer",
    "RunningComponent",
    "SimAttributeAccessor",
    "Simulator",
    "State",
    "Step",
    "TruncatedNormalParameter",
    "UniformParameter",
    "View",
    "World",
]
