"""Terms that are defined by one row kernel: `RowTerm`, the inputs of kernels, and the base class of such plugins."""

from safe_inspect.simulators.row_inputs import (
    AgentParameter,
    BodyArray,
    EnvironmentArray,
    Intervening,
    OwnArray,
    RowTerm,
    SensorMemory,
    SensorReading,
)
from safe_inspect.simulators.row_plugin import RowPlugin

__all__ = [
    "AgentParameter",
    "BodyArray",
    "EnvironmentArray",
    "Intervening",
    "OwnArray",
    "RowPlugin",
    "RowTerm",
    "SensorMemory",
    "SensorReading",
]
