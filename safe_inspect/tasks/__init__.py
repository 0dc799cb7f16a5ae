"""Components of the tasks, and the simulators composed of them. Importing this package registers their plugins."""

from safe_inspect.tasks.disturbances.component import BoundedDisturbance
from safe_inspect.tasks.disturbances.kalman_filter import KalmanFilter
from safe_inspect.tasks.disturbances.solar_pressure import SolarPressure
from safe_inspect.tasks.disturbances.thruster_model import ThrusterModel
from safe_inspect.tasks.docking.initializer import Docking3DRadialInitializer
from safe_inspect.tasks.docking.monitor import SpeedLimitMonitor
from safe_inspect.tasks.docking.simulator import CWHSimulator
from safe_inspect.tasks.inspection.fuel_price import FuelPriceSchedule
from safe_inspect.tasks.inspection.points import InspectionPoints
from safe_inspect.tasks.inspection.rotation import ChiefRotation
from safe_inspect.tasks.inspection.simulator import InspectionSimulator
from safe_inspect.tasks.inspection.sun import Sun
from safe_inspect.tasks.rendezvous.actuators import Actuators
from safe_inspect.tasks.rendezvous.target import TumblingTarget
from safe_inspect.tasks.rendezvous.tumble_parameter import RandomTumble, TriAxialTumble, TumbleParameter

__all__ = [
    "Actuators",
    "BoundedDisturbance",
    "CWHSimulator",
    "ChiefRotation",
    "Docking3DRadialInitializer",
    "FuelPriceSchedule",
    "InspectionPoints",
    "InspectionSimulator",
    "KalmanFilter",
    "RandomTumble",
    "SolarPressure",
    "SpeedLimitMonitor",
    "Sun",
    "ThrusterModel",
    "TriAxialTumble",
    "TumbleParameter",
    "TumblingTarget",
]
