"""The operation codes of the fused step's table."""

from __future__ import annotations

from typing import Final

#: What is called in Python, its result handed to the kernel.
FOREIGN: Final = 0

# Vectors, worked out once for a row: what they write into the row's room.
NEAREST_CENTRE: Final = 1
NEAREST_POSITIONS: Final = 2
NEAREST_VELOCITIES: Final = 3
NEAREST_PRESENCE: Final = 4
RANGE: Final = 5

# Elements of an observation: where the value comes from.
FLOAT: Final = 1
WHOLE: Final = 2
ANGLE: Final = 3
ROOM: Final = 4

# Terms of the reward.
NEW_POINTS: Final = 1
ALL_POINTS: Final = 2
NEAR: Final = 3
FUEL: Final = 4
INTERVENTION: Final = 5

# Ends.
FAR: Final = 1
CLOSE: Final = 2
COUNT: Final = 3
