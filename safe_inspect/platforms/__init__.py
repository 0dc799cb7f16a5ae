"""Platforms and their parts: controllers and sensors. Importing the package registers them."""

from safe_inspect.platforms.attitude_sensors import (
    AngularVelocitySensor,
    OrbitStabilitySensor,
    OrientationUnitVectorSensor,
    QuaternionSensor,
    RelativePositionSensor,
    RelativeVelocitySensor,
    RotatedAxesSensor,
)
from safe_inspect.platforms.base import Controller, Part, Platform, Property, Sensor
from safe_inspect.platforms.coasting_inspection import CoastingInspectionSensor
from safe_inspect.platforms.controllers import MomentProp, RateController, ThrustProp
from safe_inspect.platforms.cwh import CWHPlatform, SixDofPlatform
from safe_inspect.platforms.docking_sensors import ApproachVelocitySensor, SpeedLimitSensor, SpeedSensor
from safe_inspect.platforms.entity_sensors import EntityPositionSensor, EntityVelocitySensor
from safe_inspect.platforms.neighbour_sensors import (
    ClosestApproachPositionSensor,
    DeputyScanSensor,
    NearestDeputiesPositionSensor,
    NearestDeputiesPresenceSensor,
    NearestDeputiesVelocitySensor,
)
from safe_inspect.platforms.outlook_sensors import CoastingRangeSensor, CoastingTimeToLimitsSensor, TimeLeftSensor
from safe_inspect.platforms.point_sensors import (
    InspectedPointsScoreSensor,
    InspectedPointsSensor,
    PriorityVectorSensor,
    UninspectedPointsSensor,
)
from safe_inspect.platforms.state_sensors import PositionSensor, SunAngleSensor, SunDirectionSensor, VelocitySensor
from safe_inspect.platforms.target_sensors import (
    ClearanceSensor,
    MatingPointPositionSensor,
    MatingPointVelocitySensor,
    TargetAngularVelocitySensor,
    TargetAxesSensor,
)
from safe_inspect.platforms.uninspected_sensors import UninspectedPointsMapSensor, UninspectedPointsMomentsSensor

__all__ = [
    "AngularVelocitySensor",
    "ApproachVelocitySensor",
    "CWHPlatform",
    "ClearanceSensor",
    "ClosestApproachPositionSensor",
    "CoastingInspectionSensor",
    "CoastingRangeSensor",
    "CoastingTimeToLimitsSensor",
    "Controller",
    "DeputyScanSensor",
    "EntityPositionSensor",
    "EntityVelocitySensor",
    "InspectedPointsScoreSensor",
    "InspectedPointsSensor",
    "MatingPointPositionSensor",
    "MatingPointVelocitySensor",
    "MomentProp",
    "NearestDeputiesPositionSensor",
    "NearestDeputiesPresenceSensor",
    "NearestDeputiesVelocitySensor",
    "OrbitStabilitySensor",
    "OrientationUnitVectorSensor",
    "Part",
    "Platform",
    "PositionSensor",
    "PriorityVectorSensor",
    "Property",
    "QuaternionSensor",
    "RateController",
    "RelativePositionSensor",
    "RelativeVelocitySensor",
    "RotatedAxesSensor",
    "Sensor",
    "SixDofPlatform",
    "SpeedLimitSensor",
    "SpeedSensor",
    "SunAngleSensor",
    "SunDirectionSensor",
    "TargetAngularVelocitySensor",
    "TargetAxesSensor",
    "ThrustProp",
    "TimeLeftSensor",
    "UninspectedPointsMapSensor",
    "UninspectedPointsMomentsSensor",
    "UninspectedPointsSensor",
    "VelocitySensor",
]
