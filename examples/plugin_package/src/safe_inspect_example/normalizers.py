"""A normaliser that is no affine map."""

import numpy as np

from safe_inspect.glues import Normalizer
from safe_inspect.units import quantity


class TanhNormalizer(Normalizer):
    """tanh(x / scale), element by element: near 0 as good as linear, and never beyond -1 and 1.

    Attributes:
        scale: Value that becomes 0.76, in the unit of the values.
    """

    scale: quantity("", gt=0) = 100.0

    def __call__(self, values, low, high):
        """Return tanh(values / scale), shape (R, k)."""
        return np.tanh(values / self.scale)

    def inverse(self, values, low, high):
        """Return scale artanh(values), shape (R, k)."""
        return self.scale * np.arctanh(values)
