"""Simulators: state, step, points, initialisers and reset parameters. Importing it registers their plugins."""

from safe_inspect.simulators.initializers import (
    CWH3DRadialWithSunInitializer,
    Initializer,
    PositionVelocityInitializer,
    RejectionSamplerInitializer,
)
from safe_inspect.simulators.inspection_simulator import InspectionSimulator, Simulator
from safe_inspect.simulators.parameters import (
    ConstantParameter,
    Draw,
    Parameter,
    SimAttributeAccessor,
    TruncatedNormalParameter,
    UniformParameter,
)
from safe_inspect.simulators.view import Step, View

__all__ = [
    "CWH3DRadialWithSunInitializer",
    "ConstantParameter",
    "Draw",
    "Initializer",
    "InspectionSimulator",
    "Parameter",
    "PositionVelocityInitializer",
    "RejectionSamplerInitializer",
    "SimAttributeAccessor",
    "Simulator",
    "Step",
    "TruncatedNormalParameter",
    "UniformParameter",
    "View",
]
