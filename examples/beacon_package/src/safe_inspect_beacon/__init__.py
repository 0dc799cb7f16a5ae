"""A vehicle and a task of another package. Importing it registers the plugins."""

from safe_inspect_beacon.beacon import MovingBeacon
from safe_inspect_beacon.dynamics import DragPointMass
from safe_inspect_beacon.terms import BeaconProgressReward, BeaconReachedDone, BeaconSensor

__all__ = ["BeaconProgressReward", "BeaconReachedDone", "BeaconSensor", "DragPointMass", "MovingBeacon"]
