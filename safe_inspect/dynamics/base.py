"""`Dynamics`: how a vehicle moves; the simulator knows a vehicle by its arrays, control and row kernel alone."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from safe_inspect.compiling import Kernel, generate
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.types import ArraySpec


class Dynamics(Plugin):
    """Motion of bodies under held controls, one row kernel for all of them.

    Calling it with a step gives the parameters of the row kernel:

        rate = row(*parameters, *arrays, control, mass)

    The kernel advances one body over one physics step in place and returns the velocity change that it spends in a
    second [m/s^2]. `arrays` are those of the body, each without its leading axes; `control` is what is held, shape
    (`control_size`,), zeros for a body without thrusters; `mass` is in kg.

    Class attributes:
        row: The row kernel.
        arrays: Arrays of one body by name, in the kernel's order, SI units. The first two are ``position`` [m] and
            ``velocity`` [m/s], shape (3,).
        control_size: Number of elements of the control, C.
        control_unit: Their SI unit.
    """

    kind: ClassVar[str] = "dynamics"
    row: ClassVar[Kernel[..., float]]
    arrays: ClassVar[Mapping[str, ArraySpec]] = {"position": ArraySpec((3,)), "velocity": ArraySpec((3,))}
    control_size: ClassVar[int] = 3
    control_unit: ClassVar[str] = "N"

    @property
    def turns_thrust(self) -> bool:
        """Whether the thrust, the first three elements of the control, stands in body axes. False by default."""
        return False

    @abstractmethod
    def __call__(self, step_size: float) -> tuple[Any, ...]:
        """Return the first arguments of the row kernel: arrays and numbers.

        Args:
            step_size: Length of a physics step [s].
        """

    def initial(self) -> Mapping[str, Sequence[float]]:
        """Return values of arrays by name, for bodies whose initialiser gives none; zeros by default."""
        return {}

    def offers(self) -> Mapping[str, Any]:
        """Return what plugins find by name in `World`, such as ``mean_motion``. Nothing by default."""
        return {}


def advance_kernel(dynamics: Dynamics, step_size: float) -> Kernel[..., None]:
    """Return the compiled loop of a vehicle's row kernel over environments, bodies and physics steps.

        advance(*parameters, *arrays, control, masses, step_size, physics_steps, delta_v, time, step)

    Args:
        dynamics: The dynamics.
        step_size: Length of a physics step [s].
    """
    parameters = ", ".join(f"p{index}" for index in range(len(dynamics(step_size))))
    arrays = ", ".join(f"a{index}" for index in range(len(dynamics.arrays)))
    rows = ", ".join(f"a{index}[n, b]" for index in range(len(dynamics.arrays)))
    first = f"{parameters}, " if parameters else ""
    source = f"""import numpy as np


def advance({first}{arrays}, control, masses, step_size, physics_steps, delta_v, time, step):
    deputies, idle = masses.shape[0], np.empty(control.shape[2])
    for k in range(len(idle)):
        idle[k] = 0.0
    for n in range(a0.shape[0]):
        for b in range(a0.shape[1]):
            held, mass = (control[n, b], masses[b]) if b < deputies else (idle, 1.0)
            for _ in range(physics_steps):
                rate = row({first}{rows}, held, mass)
                if b < deputies:
                    delta_v[n, b] += rate * step_size
        time[n] += step_size * physics_steps
        step[n] += 1
"""
    return generate("advance", source, {"row": dynamics.row}, {"error_model": "numpy"})
