"""Platforms and their parts: controllers and sensors. Importing it registers them."""

from safe_inspect.platforms.base import Controller, Part, Platform, Property, Sensor
from safe_inspect.platforms.controllers import RateController, ThrustProp
from safe_inspect.platforms.cwh import CWHPlatform
from safe_inspect.platforms.entity_sensors import EntityPositionSensor, EntityVelocitySensor
from safe_inspect.platforms.neighbour_sensors import (
    DeputyScanSensor,
    NearestDeputiesPositionSensor,
    NearestDeputiesPresenceSensor,
    NearestDeputiesVelocitySensor,
)
from safe_inspect.platforms.point_sensors import InspectedPointsSensor, UninspectedPointsSensor
from safe_inspect.platforms.state_sensors import PositionSensor, SunAngleSensor, SunDirectionSensor, VelocitySensor

__all__ = [
    "CWHPlatform",
    "Controller",
    "DeputyScanSensor",
    "EntityPositionSensor",
    "EntityVelocitySensor",
    "InspectedPointsSensor",
    "NearestDeputiesPositionSensor",
    "NearestDeputiesPresenceSensor",
    "NearestDeputiesVelocitySensor",
    "Part",
    "Platform",
    "PositionSensor",
    "Property",
    "RateController",
    "Sensor",
    "SunAngleSensor",
    "SunDirectionSensor",
    "ThrustProp",
    "UninspectedPointsSensor",
    "VelocitySensor",
]
