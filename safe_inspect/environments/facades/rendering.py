"""`Rendering`: images of environments, drawn with Pillow."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.errors import MissingLibraryError, SafeInspectError
from safe_inspect.geometry import picture
from safe_inspect.types import AnyArray, BoolArray, FloatArray, IntArray

#: Frames per second of a recording, for Gymnasium's wrappers: an episode of 400 steps becomes a video of 16 s.
RENDER_FPS = 25
RENDER_MODE = "rgb_array"

_SIZE, _FINE = 480, 2  # pixels; drawn at twice the size and averaged, so that lines are smooth
_CORNERS = 73  # number of corners of the polygons that draw circles and rings


class Rendering:
    """Images of environments: the chief with its points, the sun, and each deputy with its path and its thrust.

    Args:
        environment: The batch; its state is read whenever an image is drawn.
    """

    def __init__(self, environment: TeamEnvironment) -> None:
        world = environment.simulation.world
        points = world.offers.world.get("points", {})
        self._environment, self._deputies = environment, world.num_deputies
        self._body = next(iter(points), None)
        self._points = points[self._body].points if self._body is not None else np.zeros((0, 3))
        self._radius = float(np.sqrt(np.square(self._points).sum(axis=-1)).max(initial=0.0))
        self._ways: list[list[FloatArray]] = [[] for _ in range(environment.num_envs)]

    def begin(self, rows: IntArray | None = None) -> None:
        """Record that new episodes have started in some rows, or in all rows."""
        positions = self._positions()
        for row in range(len(self._ways)) if rows is None else rows.tolist():
            self._ways[row] = [positions[row]]

    def follow(self, rows: BoolArray) -> None:
        """Record the state after a step of a mask of environments, shape (N,)."""
        positions = self._positions()
        for row in np.flatnonzero(rows).tolist():
            self._ways[row].append(positions[row])

    def picture(self, row: int = 0) -> AnyArray:
        """Return an image of the current state of an environment: red, green and blue, uint8, shape (480, 480, 3).

        Raises:
            SafeInspectError: No episode has started.
        """
        if not self._ways[row]:
            raise SafeInspectError("no episode has begun; call reset() first")
        from PIL import Image, ImageDraw

        canvas = Image.new("RGB", (_SIZE * _FINE, _SIZE * _FINE), "white")
        self._draw(ImageDraw.Draw(canvas), row)
        return np.asarray(canvas.reduce(_FINE))

    def _positions(self) -> FloatArray:
        return np.array(self._environment.state["position"][:, : self._deputies])

    def _draw(self, draw: Any, row: int) -> None:
        way = np.stack(self._ways[row])
        reach = _round_radius(float(np.sqrt(np.square(way).sum(axis=-1)).max()))
        middle, scale = _SIZE * _FINE / 2.0, _SIZE * _FINE / 2.3 / reach

        def outline(corners: FloatArray) -> list[tuple[float, float]]:
            return [(middle + scale * x, middle - scale * y) for x, y in corners.tolist()]

        def flat(points: FloatArray) -> list[tuple[float, float]]:
            return outline(picture.FRONT.flat(points))

        state = self._environment.state
        for radius in (0.5 * reach, reach):
            places = flat(picture.ring(radius, _CORNERS))
            draw.line(places, fill=picture.PALE, width=_FINE)
            draw.text(places[56], f"{radius:g} m", fill=picture.GREY, font_size=11 * _FINE, anchor="mm")
        hidden = picture.FRONT.hidden(way, self._radius)
        for behind in (True, False):
            if not behind:
                self._draw_chief(draw, row, outline, flat, reach)
            for deputy in range(self._deputies):
                colour = picture.DEPUTY_COLOURS[deputy % len(picture.DEPUTY_COLOURS)]
                places = flat(way[:, deputy])
                for first, last in _runs(hidden[1:, deputy] == behind):
                    draw.line(places[first : last + 1], fill=colour, width=2 * _FINE)
                if hidden[-1, deputy] == behind:
                    thrust = state["control"][row, deputy, :3] if len(way) > 1 else np.zeros(3)
                    size = float(np.sqrt(np.square(thrust).sum()))
                    if size:
                        tip = way[-1, deputy] + 0.15 * reach * thrust / size
                        draw.line([places[-1], *flat(tip[None])], fill=picture.BLACK, width=2 * _FINE)
                    _dot(draw, places[-1], 5.0, colour)
        self._write(draw, row)

    def _draw_chief(self, draw: Any, row: int, outline: Any, flat: Any, reach: float) -> None:
        state = self._environment.state
        radius = self._radius or 0.02 * reach
        draw.polygon(outline(picture.circle(radius, _CORNERS)), fill=picture.NIGHT, outline=picture.GREY)
        if "sun_direction" in state.arrays:
            sun = state["sun_direction"][row]
            if "sunlight" not in state.arrays or state["sunlight"][row] >= 0.5:
                draw.polygon(outline(picture.FRONT.day(sun, radius)), fill=picture.DAY)
            draw.line(flat(picture.sun_arrow(sun, reach)), fill=picture.ORANGE, width=3 * _FINE)
        if self._body is not None:
            seen = state.points[self._body].inspector[row] >= 0
            front = self._points @ picture.FRONT.sight > 0.0
            for place, inspected in zip(flat(self._points[front]), seen[front].tolist(), strict=True):
                _dot(draw, place, 2.0, picture.GREEN if inspected else picture.VERMILION)

    def _write(self, draw: Any, row: int) -> None:
        state = self._environment.state
        words = [f"{float(state['time'][row]):.0f} s"]
        if self._body is not None:
            seen = int(np.count_nonzero(state.points[self._body].inspector[row] >= 0))
            words.append(f"{seen} of {len(self._points)} points")
        words.append(f"delta-v {float(state['delta_v'][row].sum()):.3f} m/s")
        outcome = DoneStatus(int(self._environment.outcome()[row]))
        if outcome is not DoneStatus.RUNNING:
            words.append(outcome.name.lower())
        draw.text((10 * _FINE, 8 * _FINE), "    ".join(words), fill=picture.BLACK, font_size=13 * _FINE)


class Rendered:
    """The method `render` of environments, for Gymnasium and for PettingZoo."""

    _view: Rendering | None = None

    def _draw_as(self, render_mode: str | None, environment: TeamEnvironment) -> None:
        """Set the render mode; without one, there are no images.

        Raises:
            ValueError: The mode is unknown.
            MissingLibraryError: Pillow is not installed.
        """
        self.render_mode = render_mode
        if render_mode is None:
            return
        if render_mode != RENDER_MODE:
            raise ValueError(f"render_mode must be {RENDER_MODE} or None, not {render_mode!r}")
        try:
            import PIL  # noqa: F401
        except ModuleNotFoundError:
            raise MissingLibraryError("rendering needs Pillow; install it with: pip install pillow") from None
        self._view = Rendering(environment)

    def render(self) -> Any:
        """Return the image of the current state, uint8, shape (480, 480, 3); of a batch, a tuple of them.

        Raises:
            SafeInspectError: The environment was made without a render mode, or no episode has started.
        """
        if self._view is None:
            raise SafeInspectError("nothing is rendered: make the environment with render_mode='rgb_array'")
        return self._pictures(self._view)

    def _pictures(self, view: Rendering) -> Any:
        return view.picture()


def _round_radius(reach: float) -> float:
    """Return a round radius of at least 1.1 times the reach [m].

    Successive radii differ by about a quarter, so that the scale rarely changes.
    """
    power = 10.0 ** np.floor(np.log10(max(1.1 * reach, 1e-3)))
    sizes = power * np.array([1.0, 1.25, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0, 6.4, 8.0, 10.0])
    return float(sizes[np.searchsorted(sizes, 1.1 * reach)])


def _runs(shown: BoolArray) -> list[tuple[int, int]]:
    """Return the first index and the last index + 1 of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], shown, [False])).astype(np.int8)))
    return [(int(first), int(last)) for first, last in edges.reshape(-1, 2)]


def _dot(draw: Any, place: tuple[float, float], radius: float, colour: str) -> None:
    x, y = place
    size = radius * _FINE
    draw.ellipse((x - size, y - size, x + size, y + size), fill=colour, outline="white")
