"""The figure of one episode: the trajectory around the chief, the inspected points, and quantities over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from safe_inspect.evaluation.trajectory import Trajectory
from safe_inspect.figures.chief_figure import draw_chief, draw_summary
from safe_inspect.figures.drawing import style
from safe_inspect.figures.scene import draw_scene
from safe_inspect.figures.time_panels import draw_times

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def trajectory_figure(episode: Trajectory) -> Figure:
    """Draw an episode.

    On the left are the deputies' trajectories around the chief in Hill's frame, with rings of equal range in the
    orbital plane, the burns, and the direction to the sun from the start to the end. Below is the chief from two sides,
    with its points coloured by the time of their inspection. On the right, over time: the share of inspected points,
    the range, the speed with its limit, and the thrust along each axis. Each of several deputies has its own colour,
    also for the points that it inspected first. In a task without points, sun or orbit, the chief, the sun or the
    largest safe speed is not drawn; delta-v replaces the share of points.

    Raises:
        SafeInspectError: Matplotlib is not installed.
    """
    with style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(10.0, 6.8), facecolor="white")
        draw_scene(figure, episode)
        if len(episode.points):
            draw_chief(figure, episode)
        draw_summary(figure, episode)
        draw_times(figure, episode)
    return figure
