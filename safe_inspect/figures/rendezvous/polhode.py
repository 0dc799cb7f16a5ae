"""The polhode: the path of the angular velocity in the principal axes, on the ellipsoid of equal energy."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.figures.rendezvous.mission_scene import FLIGHT
from safe_inspect.geometry.picture import GREY, Camera
from safe_inspect.types import FloatArray

_CURVE_INK = "#C4C4C4"
_POLHODES = 5  # on each side of the separatrix, for comparison
POLHODE_VIEW = Camera.at(24.0, -58.0)


def draw_polhode(axes: Any, rate: FloatArray, moments: FloatArray) -> None:
    """Draw the path of the angular velocity in T, on the ellipsoid of equal energy.

    Args:
        axes: The axes in which it is drawn.
        rate: Angular velocities in T [degrees/s], shape (n, 3).
        moments: Principal moments, up to a common factor, shape (3,).
    """
    view = POLHODE_VIEW
    axes.set_aspect("equal")
    axes.set_axis_off()
    energy = float(moments @ np.square(rate[0]))  # twice the rotational energy
    if energy > 0.0:
        # The outline of the ellipsoid, and some of its other polhodes.
        scale = np.sqrt(energy / moments)
        normal = view.sight / scale
        angle = np.linspace(0.0, 2.0 * np.pi, 181)
        a = np.cross(normal, [0.0, 0.0, 1.0])
        a /= np.linalg.norm(a)
        b = np.cross(normal, a) / np.linalg.norm(normal)
        # Points of the outline have an outward normal that is perpendicular to the line of sight.
        outline = (np.cos(angle)[:, None] * a + np.sin(angle)[:, None] * b) * scale
        axes.fill(*view.flat(outline).T, facecolor="#F6F6F6", edgecolor=GREY, linewidth=0.6, zorder=1)
        for curve in _polhodes(moments, energy):
            _draw_front(axes, curve, view, moments, color=_CURVE_INK, linewidth=0.7, zorder=2)
        for k, name in enumerate("123"):
            tip = np.zeros(3)
            tip[k] = 1.12 * scale[k]
            axes.plot(*view.flat(np.stack((np.zeros(3), tip))).T, color=GREY, linewidth=0.6, linestyle=":", zorder=3)
            axes.text(*view.flat(1.1 * tip), name, color=GREY, fontsize=8, ha="center", va="center")
    _draw_front(axes, rate, view, moments, color=FLIGHT, linewidth=1.8, zorder=4)
    axes.plot(*view.flat(rate[:1]).T, "o", markersize=5, color="white", markeredgecolor=FLIGHT, zorder=5)
    axes.plot(*view.flat(rate[-1:]).T, "s", markersize=5, color=FLIGHT, markeredgecolor=FLIGHT, zorder=5)
    axes.margins(0.06)
    axes.set_title("polhode: angular velocity in T", pad=2.0)


def _polhodes(moments: FloatArray, energy: float) -> list[FloatArray]:
    """Return curves of equal angular momentum on the ellipsoid ``sum J w^2 = energy``, shape (n, 3) each.

    About axis c of the least or the largest moment, with the other two a and b,
    ``J_a (J_a - J_c) w_a^2 + J_b (J_b - J_c) w_b^2`` is constant: an ellipse in the plane of a and b.
    """
    angle, curves = np.linspace(0.0, 2.0 * np.pi, 121), []
    for c, a, b in ((0, 1, 2), (2, 0, 1)):
        weights = moments * np.abs(moments - moments[c])
        if min(weights[a], weights[b]) <= 0.0:
            continue
        most = min(weights[k] / moments[k] for k in (a, b)) * energy  # at the separatrix
        for share in (np.arange(1, _POLHODES + 1) / _POLHODES) ** 2:
            curve = np.zeros((len(angle), 3))
            curve[:, a] = np.sqrt(share * most / weights[a]) * np.cos(angle)
            curve[:, b] = np.sqrt(share * most / weights[b]) * np.sin(angle)
            rest = energy - np.square(curve) @ moments
            curve[:, c] = np.sqrt(np.maximum(rest, 0.0) / moments[c])
            curves += [curve, curve * np.where(np.arange(3) == c, -1.0, 1.0)]
    return curves


def _draw_front(axes: Any, curve: FloatArray, view: Camera, moments: FloatArray, **look: Any) -> None:
    """Draw a curve on the ellipsoid; the part on its far side is thin and dotted."""
    front = (curve * moments) @ view.sight >= 0.0
    flat = view.flat(curve)
    axes.plot(*np.where(front[:, None], flat, np.nan).T, **look)
    faint = {**look, "linewidth": 0.5 * look["linewidth"], "alpha": 0.6, "linestyle": (0, (1, 1.5))}
    axes.plot(*np.where(~front[:, None], flat, np.nan).T, **faint)
