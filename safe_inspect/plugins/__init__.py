"""The base class of all plugins, and how a configuration finds a plugin by kind and name."""

from safe_inspect.plugins.plugin import (
    ControllerName,
    DoneName,
    EntityName,
    PlatformName,
    Plugin,
    PointsName,
    SensorName,
)

__all__ = ["ControllerName", "DoneName", "EntityName", "PlatformName", "Plugin", "PointsName", "SensorName"]
