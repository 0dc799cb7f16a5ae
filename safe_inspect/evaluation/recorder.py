"""How an episode is recorded: `Recorder` keeps the states of some rows of a batch, step by step, as `Trajectory`.

In `safe_inspect.evaluation.rollouts`, `rollout` records the first episodes of a rollout (`record`), and
`record_episode` one; on the command line, ``evaluate --record K --output FOLDER``. States are those of control steps,
not of physics steps; observations, actions and rewards are not recorded. `safe_inspect.evaluation.results.files` writes
the fields to ``trajectories.npz``, as arrays that are named by episode and field, ``0/position`` or
``0/arrays/sun_angle``, with all that is no array as JSON in the array ``tree``, and reads them (`read_trajectories`).
The folder is written after the last episode, with ``evaluation.json`` and ``episodes.npz`` (the figures of all
episodes); until then, finished batches are kept with their recordings in ``FOLDER.part``. In `safe_inspect.figures`,
`trajectory_figure`, `film` and `page` draw a `Trajectory`, as the commands ``draw``, ``film`` and ``view`` do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.dynamics.quaternion import rotate
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.geometry.distance import lengths
from safe_inspect.tasks.docking.speed_limit import DockingRegion
from safe_inspect.tasks.inspection.sun import sun_directions
from safe_inspect.types import AnyArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Trajectory:
    """One recorded episode of T steps with D deputies, in SI units, and in Hill's frame unless stated otherwise.

    Attributes:
        time: Time since the reset [s], shape (T + 1,).
        position: Position of each deputy [m], shape (T + 1, D, 3).
        velocity: Velocity of each deputy [m/s], shape (T + 1, D, 3).
        control: Control commanded to each deputy for each step, after the safety filter: thrust [N], shape (T, D, 3),
            or thrust and moment [N m] of vehicles that turn, shape (T, D, 6); see `thrust`. Components of the simulator
            such as `ThrusterModel` may fly another one, which is not recorded.
        delta_v: Velocity change that each deputy has spent [m/s], by the flown control, shape (T + 1, D).
        status: How the episode ended.
        slot: Global index of the environment slot.
        deputies: Name of each deputy.
        arrays: Arrays that components record (`RunningComponent.recorded`), such as ``sun_angle`` [rad], and the
            attitude of deputies that turn: ``orientation``, quaternions [x, y, z, w] from body to Hill axes, and
            ``angular_velocity`` in body axes [rad/s], relative to inertial space unless the dynamics say otherwise
            (``rate_against: hill``). Each has the shape (T + 1, ...). They can also be read as attributes, such as
            ``trajectory.sun_angle``.
        points: Position of the inspection points about the centre of their body [m], shape (P, 3); P is 0 in a task
            without points. Of several bodies with points, only the first one is recorded. The points of a body that
            turns (`ChiefRotation`) are in its axes; ``chief_orientation`` in `arrays` is the attitude.
        inspected_at: Time at which each point was inspected [s], infinite for never, shape (P,).
        inspector: Index of the deputy that first inspected each point, -1 for none, shape (P,).
        mean_motion: Mean motion of the chief's orbit [rad/s], 0 if there is none.
        in_body_axes: Whether the thrust in `control` is in body axes; else it is in Hill's frame.
        camera: Axis in body axes and half angle [rad] of the cone of a camera that turns with each deputy, if any.
        docking_radius: Radius of the docking region about the chief [m], 0 if there is none.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    control: FloatArray
    delta_v: FloatArray
    status: DoneStatus
    slot: int
    deputies: tuple[str, ...]
    arrays: Mapping[str, FloatArray] = field(default_factory=dict)
    points: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    inspected_at: FloatArray = field(default_factory=lambda: np.zeros(0))
    inspector: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    mean_motion: float = 0.0
    in_body_axes: bool = False
    camera: tuple[tuple[float, float, float], float] | None = None
    docking_radius: float = 0.0

    def __getattr__(self, name: str) -> FloatArray:
        arrays: Mapping[str, FloatArray] = self.__dict__.get("arrays", {})
        if name not in arrays:
            known = f"; its components record {', '.join(arrays)}" if arrays else ""
            raise AttributeError(f"the recorded episode has no {name!r}{known}")
        return arrays[name]

    @property
    def thrust(self) -> FloatArray:
        """Commanded thrust of each deputy along Hill's axes at the start of each step [N], shape (T, D, 3)."""
        thrust = self.control[..., :3]
        return rotate(self.orientation[:-1], thrust) if self.in_body_axes else thrust

    @property
    def boresight(self) -> FloatArray | None:
        """Unit vector of each deputy's camera, Hill frame, shape (T + 1, D, 3); None without a camera that turns."""
        if self.camera is None:
            return None
        return rotate(self.orientation, np.broadcast_to(np.array(self.camera[0]), self.position.shape))

    @property
    def range(self) -> FloatArray:
        """Distance of each deputy from the chief's centre [m], shape (T + 1, D)."""
        return lengths(self.position)

    @property
    def speed(self) -> FloatArray:
        """Speed of each deputy in the chief's frame [m/s], shape (T + 1, D)."""
        return lengths(self.velocity)

    @property
    def radius(self) -> float:
        """Radius of the sphere of points [m]; 0 in a task without points."""
        return float(lengths(self.points).max(initial=0.0))

    @property
    def coverage(self) -> FloatArray:
        """Fraction of the points inspected so far [-], shape (T + 1,); NaN where there are no points."""
        return self._inspected_share(self.inspected_at)

    def coverage_of(self, deputy: int) -> FloatArray:
        """Return the fraction of the points that a deputy was the first to inspect so far [-], shape (T + 1,).

        Args:
            deputy: Index of the deputy.
        """
        return self._inspected_share(np.where(self.inspector == deputy, self.inspected_at, np.inf))

    def _inspected_share(self, when: FloatArray) -> FloatArray:
        if not len(when):
            return np.full(len(self.time), np.nan)
        return np.searchsorted(np.sort(when), self.time, side="right") / len(when)

    def until(self, time: float) -> Trajectory:
        """Return the episode up to a time since its reset [s]; its status is RUNNING if it is cut before its end."""
        last = max(int(np.searchsorted(self.time, time, side="right")), 1)
        if last >= len(self.time):
            return self
        rows = {name: getattr(self, name)[:last] for name in ("time", "position", "velocity", "delta_v")}
        seen = np.where(self.inspected_at <= self.time[last - 1], self.inspected_at, np.inf)
        return replace(
            self,
            **rows,
            arrays={name: array[:last] for name, array in self.arrays.items()},
            control=self.control[: last - 1],
            inspected_at=seen,
            inspector=np.where(np.isfinite(seen), self.inspector, -1),
            status=DoneStatus.RUNNING,
        )

    @property
    def sun_direction(self) -> FloatArray | None:
        """Unit vector from the chief to the sun, Hill frame, shape (T + 1, 3); None in a task without a sun."""
        angle = self.arrays.get("sun_angle")
        return None if angle is None else sun_directions(angle, self.arrays.get("beta_angle", 0.0))


_KEPT = ("time", "position", "velocity", "control", "delta_v")


class Recorder:
    """Recorder of the first rows of a batch, from a reset on.

    Args:
        environment: The batch.
        rows: Number of recorded rows.
        first_slot: Global index of the environment slot of the first row.
    """

    def __init__(self, environment: TeamEnvironment, rows: int, first_slot: int) -> None:
        self._environment = environment
        self._rows = rows
        self._slot = first_slot
        components = environment.simulation.components.values()
        self._of_deputies = ("position", "velocity", *environment.simulation.attitude)
        of_components = (name for component in components for name in component.recorded)
        self._recorded = (*environment.simulation.attitude, *of_components)
        self._states: dict[str, list[AnyArray]] = {name: [] for name in (*_KEPT, *self._recorded)}
        points = environment.simulation.world.offers.world.get("points", {})
        self._body = next(iter(points), None)
        self._points = points[self._body].points if self._body is not None else np.zeros((0, 3))
        self._inspected_at = np.full((rows, len(self._points)), np.inf)
        self._inspector = np.full((rows, len(self._points)), -1, dtype=np.int64)
        self.keep()

    def keep(self) -> None:
        """Record the current state; `trajectories` cuts states after the end of an episode."""
        if not self._rows:
            return
        state = self._environment.state
        deputies = self._environment.simulation.world.num_deputies
        for name, kept in self._states.items():
            array = state[name][: self._rows]
            kept.append((array[:, :deputies] if name in self._of_deputies else array).copy())
        if self._body is not None:
            inspector = state.points[self._body].inspector[: self._rows]
            now = np.broadcast_to(state.time[: self._rows, None], inspector.shape)
            fresh = (inspector >= 0) & np.isinf(self._inspected_at)
            self._inspected_at[fresh] = now[fresh]
            self._inspector[fresh] = inspector[fresh]

    def trajectories(self, length: IntArray, status: AnyArray) -> list[Trajectory]:
        """Return the recorded episodes, each cut to its own number of steps."""
        if not self._rows:
            return []
        simulation, dones = self._environment.simulation, self._environment.spec.agents[0].dones
        offers = simulation.world.offers.world
        regions: list[Any] = [done.functor for done in dones if isinstance(done.functor, DockingRegion)]
        whole = {name: np.stack(kept, axis=1) for name, kept in self._states.items()}
        made = []
        for row in range(self._rows):
            states = {name: array[row, : length[row] + 1] for name, array in whole.items()}
            seen = self._inspected_at[row] <= states["time"][-1]  # not the points that it passed after the end
            made.append(
                Trajectory(
                    **{name: states[name] for name in ("time", "position", "velocity", "delta_v")},
                    control=states["control"][1:],  # the control commanded for the step that led there
                    arrays={name: states[name] for name in self._recorded},
                    points=self._points,
                    inspected_at=np.where(seen, self._inspected_at[row], np.inf),
                    inspector=np.where(seen, self._inspector[row], -1),
                    status=DoneStatus(int(status[row])),
                    slot=self._slot + row,
                    deputies=simulation.world.platforms,
                    mean_motion=offers.get("mean_motion", 0.0),
                    in_body_axes=simulation.turns_thrust,
                    camera=offers.get("camera"),
                    docking_radius=float(regions[0].docking_region_radius) if regions else 0.0,
                )
            )
        return made
