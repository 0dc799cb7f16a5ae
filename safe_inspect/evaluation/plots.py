"""The figures of this package, and how they are saved."""

from safe_inspect.evaluation.drawing import save
from safe_inspect.evaluation.learning_curve import learning_curve_figure
from safe_inspect.evaluation.trajectory_figure import trajectory_figure

__all__ = ["learning_curve_figure", "save", "trajectory_figure"]
