"""Platforms and their parts: controllers and sensors. Importing the package registers them."""

from safe_inspect.platforms import (  # noqa: F401
    controllers,
    cwh,
    docking_sensors,
    neighbour_sensors,
    outlook_sensors,
    point_sensors,
    state_sensors,
)
from safe_inspect.platforms.base import Controller, Part, Platform, Sensor

__all__ = ["Controller", "Part", "Platform", "Sensor"]
