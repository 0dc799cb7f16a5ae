"""Simulators: state, step, components, initialisers and reset parameters. Importing it registers their plugins."""

from safe_inspect.simulators.component import Component, RunningComponent
from safe_inspect.simulators.resets.initializers import Initializer
from safe_inspect.simulators.resets.parameters import Draw, Parameter
from safe_inspect.simulators.simulator import ComposedSimulator, Simulator
from safe_inspect.simulators.view import Step, View

__all__ = [
    "Component",
    "ComposedSimulator",
    "Draw",
    "Initializer",
    "Parameter",
    "RunningComponent",
    "Simulator",
    "Step",
    "View",
]
