"""A named composition of dynamics and components."""

from safe_inspect.dynamics import DoubleIntegrator
from safe_inspect.simulators import Simulator


class FreeFlightSimulator(Simulator):
    """Deputies far from everything: a double integrator, and no component.

    Attributes:
        decimation: Number of physics steps in a step of the agents.
    """

    def compose(self):
        """Return the dynamics and no component."""
        return DoubleIntegrator(), ()
