"""A noise: thrusters whose thrust varies in every step, for the `disturbance` of a simulator."""

from safe_inspect.compiling import njit
from safe_inspect.random.splitmix import normal_at
from safe_inspect.simulators import Component, RunningComponent
from safe_inspect.units import NonNegativeForce

_FIRST_DRAW = 10_000  # numbers of samples that no other component uses


@njit
def shake(key, step, sigma, control):
    """Add noise to the thrusts of D deputies in N environments, shape (N, D, C), in place."""
    for i in range(control.shape[0]):
        for j in range(control.shape[1]):
            for k in range(3):
                control[i, j, k] += sigma * normal_at(key[i], step[i], _FIRST_DRAW + 3 * j + k)


class ThrustNoise(Component):
    """Gaussian noise of the thrust along each axis, a function of the seed, the slot, the episode and the step.

    Attributes:
        sigma: Standard deviation [N].
    """

    sigma: NonNegativeForce = 0.01

    def __call__(self, world, num_envs):
        """Return the running noise."""
        return _RunningNoise(self.sigma)


class _RunningNoise(RunningComponent):
    def __init__(self, sigma):
        self._sigma = sigma

    def actuate(self, state, control):
        flown = control.copy()
        shake(state["key"], state["step"], self._sigma, flown)
        return flown
