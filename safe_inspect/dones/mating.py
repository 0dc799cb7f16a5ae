"""Done functors of a rendezvous: the chaser has docked, or has touched the target."""

from __future__ import annotations

from typing import ClassVar

from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.simulators.row_terms.inputs import OwnArray
from safe_inspect.simulators.row_terms.loops import RowTerm
from safe_inspect.simulators.view import Group
from safe_inspect.simulators.world import World
from safe_inspect.tasks.rendezvous.mating import docking_inputs, is_docked, is_in_contact
from safe_inspect.units import PositiveLength, PositiveSpeed


class DockedDoneFunction(DoneFunction):
    """Win when the chaser is at the mating point of a tumbling target, with its velocity; shape (R,).

    Attributes:
        reach: Largest distance from the mating point [m].
        speed: Largest speed relative to the mating point [m/s].
    """

    status: ClassVar[DoneStatus] = DoneStatus.WIN

    reach: PositiveLength = 0.03
    speed: PositiveSpeed = 0.01

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the chaser is docked."""
        return RowTerm(is_docked, (self.reach, self.speed, *docking_inputs()))


class ContactDoneFunction(DoneFunction):
    """Lose when the chaser touches the target: the clearance of its centre is below its radius; shape (R,).

    Attributes:
        radius: Radius of the chaser [m].
    """

    status: ClassVar[DoneStatus] = DoneStatus.LOSE

    radius: PositiveLength = 0.25

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the clearance is below the radius."""
        return RowTerm(is_in_contact, (self.radius, OwnArray("clearance")))
