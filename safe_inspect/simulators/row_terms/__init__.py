"""Terms that one row kernel defines: `RowTerm`, what a kernel can be given, and the base of such plugins."""

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
