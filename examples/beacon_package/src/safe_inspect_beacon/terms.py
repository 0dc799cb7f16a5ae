"""What an agent sees of the beacon, earns on the way to it and ends on."""

from typing import ClassVar

from safe_inspect.compiling import njit
from safe_inspect.dones import DoneFunction, DoneStatus
from safe_inspect.geometry.distance import distance as distance_of
from safe_inspect.platforms import Sensor
from safe_inspect.rewards import Reward
from safe_inspect.simulators.row_terms import EnvironmentArray, OwnArray, RowTerm
from safe_inspect.units import PositiveLength
from safe_inspect_beacon.beacon import distance


class BeaconSensor(Sensor, name="Sensor_Beacon"):
    """Position of the beacon relative to the deputy [m], shape (R, 3)."""

    elements: ClassVar = ("x_beacon", "y_beacon", "z_beacon")
    symbol: ClassVar = "m"

    def __call__(self, view):
        """Return the relative position [m], shape (R, 3)."""
        return view.beacon_position - view.position


@njit
def progress(scale, position_before, beacon_before, position, beacon):
    """Return the reward of one deputy in one environment."""
    return scale * (distance_of(position_before, beacon_before) - distance_of(position, beacon))


class BeaconProgressReward(Reward):
    """Pay `scale` for every metre that the deputy has come nearer to the beacon; shape (R,).

    Attributes:
        scale: Reward of a metre [1/m].
    """

    scale: float = 0.02

    def row(self, world, group):
        """Return the kernel and what it is given; it runs in the compiled step, as the built-in rewards do."""
        own, beacon = "position", "beacon_position"
        before = OwnArray(own, before=True), EnvironmentArray(beacon, before=True)
        return RowTerm(progress, (self.scale, *before, OwnArray(own), EnvironmentArray(beacon)))


class BeaconReachedDone(DoneFunction):
    """End the episode, won, within a distance of the beacon; shape (R,).

    Attributes:
        radius: The distance [m].
    """

    status: ClassVar = DoneStatus.WIN

    radius: PositiveLength = 5.0

    def __call__(self, step):
        """Return the rows that have reached the beacon, shape (R,)."""
        return distance(step.after) < self.radius
