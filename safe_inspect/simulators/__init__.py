"""Simulators: state, step, components, initialisers and reset parameters. Importing it registers their plugins."""

from safe_inspect.simulators.component import Component, RunningComponent
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
from safe_inspect.simulators.view import Step, View

__all__ = [
    "AttitudeParameter",
    "CWH3DRadialWithSunInitializer",
    "CWHSixDOFRadialInitializer",
    "Component",
    "ComposedSimulator",
    "ConstantParameter",
    "Draw",
    "Initializer",
    "Parameter",
    "PositionVelocityInitializer",
    "RejectionSamplerInitializer",
    "RunningComponent",
    "SimAttributeAccessor",
    "Simulator",
    "Step",
    "TruncatedNormalParameter",
    "UniformParameter",
    "View",
]
