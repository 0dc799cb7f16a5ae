"""Figures, films and interactive pages. Matplotlib is imported only when a picture is drawn."""

from safe_inspect.figures.drawing import save
from safe_inspect.figures.film import Film
from safe_inspect.figures.learning_curves import curves_figure
from safe_inspect.figures.page import episode_page, save_page
from safe_inspect.figures.pictures import save_film
from safe_inspect.figures.trajectory_figure import trajectory_figure

__all__ = ["Film", "curves_figure", "episode_page", "save", "save_film", "save_page", "trajectory_figure"]
