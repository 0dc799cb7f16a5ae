"""What a plugin is, and how a configuration finds it by kind and name."""

from safe_inspect.plugins.plugin import (
    ControllerName,
    DoneName,
    EntityName,
    PlatformName,
    Plugin,
    PointsName,
    Reference,
    SensorName,
)

__all__ = [
    "ControllerName",
    "DoneName",
    "EntityName",
    "PlatformName",
    "Plugin",
    "PointsName",
    "Reference",
    "SensorName",
]
