"""The scene of a rendezvous in parallel projection, and the polhode: the path of the target's angular velocity."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from safe_inspect.dynamics.quaternion import to_matrix
from safe_inspect.geometry.picture import BLACK, BLUE, GREEN, GREY, ORANGE, PALE, PURPLE, SKY, VERMILION, Camera
from safe_inspect.geometry.pointing import R_BC
from safe_inspect.missions.record import MissionRecord
from safe_inspect.missions.summary import true_reference
from safe_inspect.rendezvous.coordination.context import Phase
from safe_inspect.rendezvous.depth_camera import TimeOfFlightCamera
from safe_inspect.rendezvous.planner.query import Plan
from safe_inspect.rendezvous.target.boxes import aligned_boxes, mesh_of_boxes
from safe_inspect.rendezvous.target.surface import MeshSurface
from safe_inspect.types import AnyArray, BoolArray, FloatArray

#: Largest number of patches along an edge of a triangle.
_MOST_PATCHES = 24
#: Brightness of a face that is turned away from the light, as a share of the largest.
_SHADE = 0.58
FLIGHT, PLANNED, TUBE, MATING, CAMERA = BLUE, VERMILION, SKY, GREEN, ORANGE
#: Line of the target where the chaser believes it.
BELIEVED = PURPLE
#: Colours of the phases; phases that are not listed take no time.
PHASE_COLOURS = {
    Phase.CHECKOUT: PALE, Phase.OBSERVE: SKY, Phase.WAIT: "#F0E442", Phase.TRACK: BLUE, Phase.MP_HOLD: GREEN,
    Phase.RETREAT: VERMILION, Phase.DEPART: VERMILION,
}  # fmt: skip
_TARGET_INK, _CHASER_INK = np.array([0.72, 0.75, 0.80]), np.array([0.98, 0.86, 0.60])
#: Length of the camera's cone [m] for each metre of the chaser's radius.
_CONE = 2.0


class DrawnSolid(NamedTuple):
    """A closed surface, divided into patches for painting.

    Attributes:
        triangles: Corners of the triangles [m], shape (F, 3, 3).
        patches: Corners of the patches [m], shape (P, 3, 3).
        normals: Their outward normals, shape (P, 3).
        edges: Pieces of the sharp edges [m], shape (E, 2, 3).
    """

    triangles: FloatArray
    patches: FloatArray
    normals: FloatArray
    edges: FloatArray

    @classmethod
    def of(cls, surface: MeshSurface, rotation: FloatArray, cell: float) -> DrawnSolid:
        """Return a surface divided into patches of about a given size [m], after a rotation, shape (3, 3)."""
        patches, normals, edges = [], [], []
        for corners, normal in zip(surface.corners, surface.normals, strict=True):
            count = _count(np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1).max(), cell)
            patches.append(_parts(corners, count))
            normals.append(np.broadcast_to(normal, (count * count, 3)))
        for first, last in surface.sharp_edges:
            share = np.linspace(0.0, 1.0, _count(np.linalg.norm(last - first), cell) + 1)[:, None]
            line = (1.0 - share) * first + share * last
            edges.append(np.stack((line[:-1], line[1:]), axis=1))
        pieces = np.concatenate(edges) if edges else np.zeros((0, 2, 3))
        parts = surface.corners, np.concatenate(patches), np.concatenate(normals), pieces
        return cls(*(part @ rotation.T for part in parts))

    @classmethod
    def of_target(cls, record: MissionRecord) -> DrawnSolid:
        """Return the target's known shape in T."""
        target = record.target
        return cls.of(MeshSurface(target.shape), target.R_MT.T, target.swept_radius / 12.0)

    @classmethod
    def of_chaser(cls, record: MissionRecord) -> DrawnSolid:
        """Return the cube, in B, that is inscribed in the sphere that encloses the chaser."""
        half = record.config.chaser.radius / np.sqrt(3.0)
        cube = mesh_of_boxes(aligned_boxes(np.zeros((1, 3)), np.full((1, 3), half)))
        return cls.of(MeshSurface(cube), np.eye(3), half)

    def hides(self, points: FloatArray, sight: FloatArray) -> BoolArray:
        """Return which points, shape (..., 3), the surface hides from a distant viewer in the direction `sight`.

        A line of sight that leaves the solid does so through a triangle that faces the viewer. With the sides e1 and e2
        at its corner a, the coordinates (u, v) in the triangle and the distance t of the place in front of a point p
        solve ``p + t d = a + u e1 + v e2`` (Moller and Trumbore, 1997).
        """
        corner, first, second = self.triangles[:, 0], *np.moveaxis(self.triangles[:, 1:] - self.triangles[:, :1], 1, 0)
        normal = np.cross(first, second)
        facing = normal @ sight > 1e-9 * np.linalg.norm(normal, axis=1)
        corner, first, second, normal = corner[facing], first[facing], second[facing], normal[facing]
        solved = np.stack((np.cross(second, sight), np.cross(sight, first), -normal), axis=1)
        solved /= (normal @ sight)[:, None, None]
        u, v, t = np.moveaxis(np.einsum("fij,...fj->...fi", solved, points[..., None, :] - corner), -1, 0)
        tiny = 1e-3 * float(np.abs(self.triangles).max())
        return np.asarray(((u > 0.0) & (v > 0.0) & (u + v < 1.0) & (t > tiny)).any(axis=-1))

    def seen_patches(self, view: Camera) -> tuple[FloatArray, FloatArray]:
        """Return the patches that face the viewer, the farthest first.

        Returns:
            Corners in the picture [m], shape (n, 3, 2), and brightness from 0 to 1, shape (n,).
        """
        front = np.flatnonzero(self.normals @ view.sight > 1e-9)
        order = front[np.argsort(self.patches[front].mean(axis=1) @ view.sight, kind="stable")]
        light = view.sight + 0.55 * view.up - 0.35 * view.right
        bright = np.clip(self.normals[order] @ (light / np.linalg.norm(light)), 0.0, 1.0)
        return view.flat(self.patches[order]), _SHADE + (1.0 - _SHADE) * bright

    def seen_edges(self, view: Camera) -> FloatArray:
        """Return the pieces of the edges that are not hidden, in the picture [m], shape (n, 2, 2)."""
        return view.flat(self.edges[~self.hides(self.edges.mean(axis=1), view.sight)])


def _count(length: Any, cell: float) -> int:
    """Return the number of patches along a side of a given length."""
    return int(np.clip(np.ceil(length / cell), 1, _MOST_PATCHES))


def _parts(corners: FloatArray, count: int) -> FloatArray:
    """Return a triangle, shape (3, 3), divided along its sides into `count` parts, shape (count^2, 3, 3)."""
    i, j = np.nonzero(np.add.outer(np.arange(count), np.arange(count)) < count)
    upright = np.stack([(i, j), (i + 1, j), (i, j + 1)])  # corner, coordinate, part
    i, j = np.nonzero(np.add.outer(np.arange(count - 1), np.arange(count - 1)) < count - 1)
    turned = np.stack([(i + 1, j), (i + 1, j + 1), (i, j + 1)])
    places = np.concatenate((upright, turned), axis=2).transpose(2, 0, 1) / count
    return np.asarray(corners[0] + places @ (corners[1:] - corners[0]))


def best_view(path: FloatArray, solid: DrawnSolid, rotation: FloatArray) -> Camera:
    """Return the view in which most of a path is visible and its end is far from the origin, from slightly above.

    Args:
        path: Points [m], shape (K, 3).
        solid: The solid that may hide it.
        rotation: Rotation from the solid's frame to the path's, shape (3, 3).
    """

    def seen(view: Camera) -> float:
        lengths = np.linalg.norm(np.diff(view.flat(path), axis=0), axis=1)
        shown = lengths[~solid.hides(path[1:] @ rotation, view.sight @ rotation)].sum()
        return float(shown + 2.0 * np.linalg.norm(view.flat(path[-1])))

    return max((Camera.at(e, a) for e in (20.0, 35.0) for a in range(-180, 180, 15)), key=seen)


def camera_cone(record: MissionRecord) -> FloatArray:
    """Return the camera's position and the corners of its view at some distance, in B [m], shape (5, 3)."""
    camera, radius = TimeOfFlightCamera(), record.config.chaser.radius
    wide, tall = 0.5 * camera.width / camera.focal_length, 0.5 * camera.height / camera.focal_length
    corners = np.array([(0.0, 0.0, 0.0), *((x * wide, y * tall, 1.0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)))])
    return np.asarray(record.config.chaser.camera_position + _CONE * radius * corners @ R_BC.T)


def ribbon(path: FloatArray, width: FloatArray, view: Camera, to_axes: FloatArray | None = None) -> FloatArray:
    """Return the outline of a tube in the picture [m], shape (2 K, 2).

    A box of half width h has the half width ``h |n|_1`` along a direction n of the picture.

    Args:
        path: The tube's centre [m], shape (K, 3).
        width: Half width along each axis of W [m], shape (K,).
        view: The picture's camera.
        to_axes: Rotations from the picture's frame to W, shape (K, 3, 3); None if they are the same frame.
    """
    kept = _apart(path, width)
    path, width, to_axes = path[kept], width[kept], None if to_axes is None else to_axes[kept]
    flat = view.flat(path)
    along = np.gradient(flat, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    across = np.stack((-along[:, 1], along[:, 0]), axis=1)
    directions = across[:, :1] * view.right + across[:, 1:] * view.up
    if to_axes is not None:
        directions = np.einsum("kij,kj->ki", to_axes, directions)
    offset = across * (width * np.abs(directions).sum(axis=1))[:, None]
    return np.concatenate((flat + offset, (flat - offset)[::-1]))


def _apart(path: FloatArray, width: FloatArray) -> AnyArray:
    """Return the indices of points that are apart by a share of a tube's width, so that they define a direction."""
    kept = [0]
    for k in range(1, len(path)):
        if np.linalg.norm(path[k] - path[kept[-1]]) > max(0.3 * width[k], 1e-3):
            kept.append(k)
    return np.array(kept if len(kept) > 1 else [0, len(path) - 1])


def show_extent(axes: Any, low: FloatArray, high: FloatArray, aspect: float) -> None:
    """Set the axes to show a rectangle, widened to a given aspect of width over height."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    half = np.maximum(half, [half[1] * aspect, half[0] / aspect])
    axes.set(xlim=(middle[0] - half[0], middle[0] + half[0]), ylim=(middle[1] - half[1], middle[1] + half[1]))


class SceneArtists:
    """Moving parts of a scene: target, chaser, camera, paths and tube.

    Args:
        axes: The axes in which they are drawn.
        record: The mission.
        in_target: Whether the scene is drawn in the target's principal axes T instead of W.

    Attributes:
        in_target: Whether the scene is drawn in T.
        path: Path of the chaser in this frame [m], shape (K, 3).
    """

    def __init__(self, axes: Any, record: MissionRecord, in_target: bool) -> None:
        from matplotlib.collections import LineCollection, PolyCollection
        from matplotlib.patches import Circle

        axes.set_aspect("equal")
        axes.set_axis_off()
        self.in_target, self._widths = in_target, record.arrays["tube"]
        self.path = record.position_in_target() if in_target else record.arrays["x"][:, :3]
        self._centre, self._attitude = true_reference(record.arrays), to_matrix(record.arrays["target_q"])
        if in_target:
            self._centre = np.einsum("kji,kj->ki", self._attitude, self._centre)
        self._radius = record.config.chaser.radius
        self._mating_point = record.target.mating_point
        self._target, self._chaser = DrawnSolid.of_target(record), DrawnSolid.of_chaser(record)
        self._cone = camera_cone(record)

        def faces(place: float) -> Any:
            return axes.add_collection(PolyCollection([], linewidths=0.35, zorder=place), autolim=False)

        def strokes(place: float, colour: str, width: float) -> Any:
            own = LineCollection([], colors=colour, linewidths=width, zorder=place, capstyle="round")
            return axes.add_collection(own, autolim=False)

        def line(place: float, colour: str, width: float, dashes: Any = "-") -> Any:
            return axes.plot([], [], color=colour, linewidth=width, linestyle=dashes, zorder=place)[0]

        self._faces, self._edges = faces(3.0), strokes(3.1, "#4B5563", 0.55)
        self._believed = strokes(3.2, BELIEVED, 0.8)
        self._chaser_faces, self._chaser_edges = faces(6.0), strokes(6.1, BLACK, 0.7)
        self._sphere = axes.add_patch(Circle((0.0, 0.0), self._radius, facecolor="none", edgecolor=GREY, linewidth=0.7))
        self._cone_lines = strokes(5.9, CAMERA, 0.9)
        (self._tube,) = axes.fill([0.0], [0.0], facecolor=TUBE, alpha=0.45, edgecolor=TUBE, linewidth=0.3, zorder=3.5)
        dashes = (0, (4.0, 2.0))
        self._paths = {
            "before": (line(2.0, "#B8C4D0", 0.9), line(4.0, "#B8C4D0", 0.9)),
            "plan": (line(2.1, PLANNED, 0.6, (0, (1, 2))), line(4.2, PLANNED, 1.1, dashes)),
            "flight": (line(2.2, FLIGHT, 0.6, (0, (1, 1.5))), line(4.1, FLIGHT, 1.9)),
        }
        self._mark = axes.plot(
            [], [], linestyle="", marker="*", markersize=11, color=MATING, markeredgecolor="white", zorder=7.0
        )[0]

    def best_view(self, first: int) -> Camera:
        """Return the view in which most of the path is visible from a step on, with the target as at the end."""
        return best_view(self.path[first:], self._target, np.eye(3) if self.in_target else self._attitude[-1])

    def show(
        self,
        pose: tuple[FloatArray, FloatArray],
        view: Camera,
        way: FloatArray,
        plan: Plan | None,
        rows: AnyArray,
        believed: tuple[FloatArray, FloatArray] | None = None,
    ) -> None:
        """Draw a moment.

        Args:
            pose: Rotations from B to W and from T to W, shape (3, 3) each.
            view: The picture's camera.
            way: The flight so far in the picture's frame [m], shape (n, 3).
            plan: The newest plan; None before the first one.
            rows: The control steps whose tube is drawn.
            believed: Where the chaser believes the target, see `MissionRecord.believed_target`.
        """
        body, target = pose
        rotation = np.eye(3) if self.in_target else target
        self._show_target(view, rotation)
        turn, offset = believed or (np.eye(3), np.zeros(3))
        ends = self._target.edges if believed else np.zeros((0, 2, 3))
        self._believed.set_segments(list(view.flat((ends @ turn.T + offset) @ rotation.T)))
        self.show_path("flight", way, view, rotation)
        if plan is not None:
            self.show_path("plan", plan.position_target if self.in_target else plan.position, view, rotation)
        outline = np.zeros((3, 2))
        if len(rows) > 1:
            to_axes = self._attitude[rows] if self.in_target else None
            outline = ribbon(self._centre[rows], self._widths[rows], view, to_axes)
        self._tube.set_xy(outline)
        self._show_chaser(way[-1], target.T @ body if self.in_target else body, view, rotation)

    def _show_target(self, view: Camera, rotation: FloatArray) -> None:
        """Draw the target and its mating point, given the rotation from T to the picture's frame."""
        own = view.turned(rotation)
        _paint(self._faces, self._edges, self._target, own, np.zeros(2), _TARGET_INK)
        self._mark.set_data(*own.flat(self._mating_point[None]).T)
        self._mark.set_alpha(0.35 if self._target.hides(self._mating_point, own.sight) else 1.0)

    def show_path(self, name: str, path: FloatArray, view: Camera, rotation: FloatArray) -> None:
        """Draw a path, shape (K, 3), with the parts that the target hides in another style.

        Args:
            name: ``before``, ``plan`` or ``flight``.
            path: The path in the picture's frame [m].
            view: The picture's camera.
            rotation: Rotation from T to the picture's frame, shape (3, 3).
        """
        hidden = self._target.hides(path @ rotation, view.sight @ rotation)
        flat = view.flat(path)
        for line, which in zip(self._paths[name], (hidden, ~hidden), strict=True):
            line.set_data(*np.where(_joined(which)[:, None], flat, np.nan).T)

    def _show_chaser(self, position: FloatArray, body: FloatArray, view: Camera, target: FloatArray) -> None:
        """Draw the chaser, its sphere, and the cone of its camera.

        Args:
            position: Position in the picture's frame [m], shape (3,).
            body: Rotation from B to the picture's frame, shape (3, 3).
            view: The picture's camera.
            target: Rotation from T to the picture's frame, shape (3, 3).
        """
        place = view.flat(position)
        own = view.turned(body)
        _paint(self._chaser_faces, self._chaser_edges, self._chaser, own, place, _CHASER_INK)
        self._sphere.center = place.tolist()
        corner = own.flat(self._cone) + place
        self._cone_lines.set_segments([corner[[0, k]] for k in range(1, 5)] + [corner[[1, 2, 3, 4, 1]]])
        behind = bool(self._target.hides(position @ target, view.sight @ target))
        for k, artist in enumerate((self._cone_lines, self._sphere, self._chaser_faces, self._chaser_edges)):
            artist.set_zorder((2.5 if behind else 6.0) + 0.1 * k)


def _paint(faces: Any, edges: Any, solid: DrawnSolid, view: Camera, place: FloatArray, ink: FloatArray) -> None:
    corners, brightness = solid.seen_patches(view)
    colours = np.clip(brightness[:, None] * ink, 0.0, 1.0)
    faces.set_verts(list(corners + place))
    faces.set_facecolor(colours)
    faces.set_edgecolor(colours)
    edges.set_segments(list(solid.seen_edges(view) + place))


def _joined(shown: BoolArray) -> BoolArray:
    """Return the mask of shown points extended by the point before each piece, so that the pieces meet."""
    joined = shown.copy()
    joined[:-1] |= shown[1:]
    return joined


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
