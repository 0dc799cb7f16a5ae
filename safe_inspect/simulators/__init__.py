"""Simulators: state, step, components, initialisers and reset parameters. Importing it registers their plugins."""

from safe_inspect.simulators.component import Component, PassiveComponent, RunningComponent
from safe_inspect.simulators.offers import OfView, OwnOfView
from safe_inspect.simulators.resets.initializers import Initializer
from safe_inspect.simulators.resets.parameters import Draw, Parameter
from safe_inspect.simulators.simulator import ComposedSimulator, Simulator
from safe_inspect.simulators.state import State
from safe_inspect.simulators.view import Group, Step, View
from safe_inspect.simulators.world import World

__all__ = [
    "Component",
    "ComposedSimulator",
    "Draw",
    "Group",
    "Initializer",
    "OfView",
    "OwnOfView",
    "Parameter",
    "PassiveComponent",
    "RunningComponent",
    "Simulator",
    "State",
    "Step",
    "View",
    "World",
]
