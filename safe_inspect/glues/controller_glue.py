"""`ControllerGlue`: the part of an action that commands a controller."""

from __future__ import annotations

from safe_inspect.glues.base import ActionGlue, Bounds, Parts, controller_of
from safe_inspect.glues.normalization import Normalization
from safe_inspect.plugins.plugin import ControllerName
from safe_inspect.types import FloatArray


class ControllerGlue(ActionGlue):
    """The command of a controller, in the normaliser's range, or in SI units without normalisation.

    Attributes:
        controller: Name of the controller.
        normalization: Mapping of the action to the controller's limits; from [-1, 1] by default.
    """

    controller: ControllerName = "RateController"
    normalization: Normalization = Normalization()

    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return the controller's name, with an index if the controller takes several values."""
        size = controller_of(parts, self.controller).size
        return (self.controller,) if size == 1 else tuple(f"{self.controller}.{index}" for index in range(size))

    def bounds(self, parts: Parts) -> Bounds:
        """Return the bounds of the action.

        Raises:
            ValueError: The normaliser does not match the controller.
        """
        low, high = controller_of(parts, self.controller).limits
        normalizer = self.normalization.active
        if normalizer is None:
            return low, high
        normalizer.check(len(low), low, high)
        return normalizer(low, low, high), normalizer(high, low, high)

    def __call__(self, action: FloatArray, parts: Parts) -> FloatArray:
        """Return the controller's part of the thrust [N], shape (R, 3), or of the control [N, N m], shape (R, 6)."""
        controller = controller_of(parts, self.controller)
        normalizer = self.normalization.active
        return controller(action if normalizer is None else normalizer.inverse(action, *controller.limits))
