"""Terms that are defined by one row kernel: `RowTerm`, the inputs of kernels, and the base class of such plugins."""

from safe_inspect.simulators.row_terms.inputs import (
    AgentParameter,
    BodyArray,
    EnvironmentArray,
    Intervening,
    OwnArray,
    SensorMemory,
    SensorReading,
)
from safe_inspect.simulators.row_terms.loops import RowTerm
from safe_inspect.simulators.row_terms.plugin import RowPlugin

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
