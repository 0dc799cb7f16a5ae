"""Gymnasium spaces of a layout."""

from __future__ import annotations

import numpy as np
from gymnasium.spaces import Box, MultiDiscrete

from safe_inspect.environments.layout import Layout


def box(layout: Layout) -> Box:
    """Return the float32 box of a layout; a bound that float32 cannot represent is rounded outwards."""
    low, high = layout.low.astype(np.float32), layout.high.astype(np.float32)
    low = np.where(low > layout.low, np.nextafter(low, np.float32(-np.inf)), low)
    high = np.where(high < layout.high, np.nextafter(high, np.float32(np.inf)), high)
    return Box(low, high, dtype=np.float32)


def action_space(layout: Layout) -> Box | MultiDiscrete:
    """Return the space of an action: indices of levels if the layout is discrete, else a box."""
    return MultiDiscrete(list(layout.choices)) if layout.choices else box(layout)
