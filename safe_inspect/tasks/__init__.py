"""The components of tasks, and the simulators composed of them. Importing it registers their plugins."""

from safe_inspect.tasks.inspection.fuel_price import FuelPriceSchedule
from safe_inspect.tasks.inspection.points import InspectionPoints
from safe_inspect.tasks.inspection.simulator import InspectionSimulator
from safe_inspect.tasks.inspection.sun import Sun

__all__ = ["FuelPriceSchedule", "InspectionPoints", "InspectionSimulator", "Sun"]
