"""The kinds of plugins of a rendezvous: frozen recipes without memory.

Called, a plugin returns a result, or a run: a plain object that holds the state of one mission. What a plugin needs to
work is loaded when it is called: an experiment is checked without SciPy and without the libraries of the extra.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Protocol

from pydantic import Field

from safe_inspect.plugins.plugin import Plugin

if TYPE_CHECKING:
    from safe_inspect.random.streams import Streams
    from safe_inspect.rendezvous.back_end.options import CentrePrior, ChaserStart
    from safe_inspect.rendezvous.back_end.run import BackEndRun
    from safe_inspect.rendezvous.bound.conformal import Bound
    from safe_inspect.rendezvous.bound.query import BoundQuery
    from safe_inspect.rendezvous.characterise.fit import Motion
    from safe_inspect.rendezvous.characterise.history import History, TargetEstimate
    from safe_inspect.rendezvous.control.design import TubeDesign
    from safe_inspect.rendezvous.control.lqr import TrackerOutput
    from safe_inspect.rendezvous.control.tightening import TrackedReference
    from safe_inspect.rendezvous.estimate import StateEstimate
    from safe_inspect.rendezvous.estimation.context import EstimatorContext
    from safe_inspect.rendezvous.front_end.context import FrontEndContext, FrontEndRun
    from safe_inspect.rendezvous.planner.query import Plan, PlanQuery
    from safe_inspect.rendezvous.readings import Reading, Readings
    from safe_inspect.rendezvous.sensors.imu import ImuNoise
    from safe_inspect.rendezvous.sensors.tof import DepthCamera, DepthRenderer
    from safe_inspect.rendezvous.target.model import Target
    from safe_inspect.rendezvous.tracking import DesignRequest
    from safe_inspect.types import FloatArray


#: The name of a file that a plugin reads, as a configuration gives it; see `experiment.load_rendezvous`.
DataFile = Annotated[str, Field(min_length=1, json_schema_extra={"file": True})]


class EstimatorRun(Protocol):
    """The estimator of one mission."""

    def update(self, readings: Readings) -> StateEstimate:
        """Return the newest estimate; called once for each step of control.

        Args:
            readings: What the sensors have given since the last call.
        """


class TrackerRun(Protocol):
    """The tracker of one approach."""

    def step(self, estimate: FloatArray, reference: TrackedReference, k: int) -> TrackerOutput:
        """Return the force at step k of the reference for position and velocity in W, shape (6,)."""


class TargetModel(Plugin):
    """Base of target models."""

    kind: ClassVar[str] = "target_model"

    @abstractmethod
    def __call__(self) -> Target:
        """Return the target."""


class Tumble(Plugin):
    """Base of tumbles: the target's attitude and angular velocity at the start of a mission."""

    kind: ClassVar[str] = "tumble"

    @abstractmethod
    def __call__(self, streams: Streams) -> tuple[FloatArray, FloatArray]:
        """Return q_WT, shape (4,), and the angular velocity in T [rad/s], shape (3,), of a mission."""


class DepthCameraModel(Plugin):
    """Base of depth cameras."""

    kind: ClassVar[str] = "depth_camera"

    @abstractmethod
    def __call__(self, target: Target) -> DepthRenderer:
        """Return what takes frames of a target."""

    @property
    @abstractmethod
    def geometry(self) -> DepthCamera:
        """The camera's geometry."""


class FrontEnd(Plugin):
    """Base of front ends: from depth frames to relative poses of the target.

    Attributes:
        reads: ``frames`` of a depth camera, or ``poses`` that a simulated sensor measures in their place.
    """

    kind: ClassVar[str] = "front_end"
    reads: ClassVar[Literal["frames", "poses"]] = "frames"

    @abstractmethod
    def __call__(self, context: FrontEndContext) -> FrontEndRun:
        """Return the front end of a mission."""


class BackEnd(Plugin):
    """Base of back ends: from relative poses and inertial measurements to the states of chaser and target."""

    kind: ClassVar[str] = "back_end"

    @abstractmethod
    def __call__(self, imu: ImuNoise, period: float, start: ChaserStart, centre: CentrePrior) -> BackEndRun:
        """Return the back end of a mission that starts at frame 0, with samples of the unit every `period` [s]."""


class Characteriser(Plugin):
    """Base of characterisers: from the history of relative poses to the target's motion."""

    kind: ClassVar[str] = "characteriser"

    @abstractmethod
    def __call__(
        self, history: History, target: Target | None, before: Motion | None, model: FloatArray | None
    ) -> TargetEstimate | None:
        """Return how the target tumbles, or None where there is too little to tell.

        Args:
            history: What was measured.
            target: The target where it is known.
            before: The motion as it was known before.
            model: q_GM of the known model, shape (4,), where it is known.
        """


class StateEstimator(Plugin):
    """Base of estimators: what the chaser knows of itself and of the target."""

    kind: ClassVar[str] = "state_estimator"

    @abstractmethod
    def __call__(self, context: EstimatorContext) -> EstimatorRun:
        """Return the estimator of a mission."""

    @property
    def reads(self) -> tuple[Reading, ...]:
        """What it reads of the sensors; the others are not simulated."""
        return ("frames", "inertial")


class ApproachPlanner(Plugin):
    """Base of planners."""

    kind: ClassVar[str] = "approach_planner"

    @abstractmethod
    def __call__(self, query: PlanQuery) -> Plan:
        """Return a plan, whose status says if it may be flown."""


class UncertaintyBound(Plugin):
    """Base of bounds of the error of the reference."""

    kind: ClassVar[str] = "uncertainty_bound"

    @abstractmethod
    def __call__(self, query: BoundQuery, streams: Streams) -> Bound:
        """Return bounds at the samples of the plan, with the random streams of one mission."""


class Tracker(Plugin):
    """Base of trackers of a reference."""

    kind: ClassVar[str] = "tracker"

    @abstractmethod
    def design(self, request: DesignRequest) -> TubeDesign:
        """Return the tube of a plan, or why there is none."""

    @abstractmethod
    def __call__(self, design: TubeDesign) -> TrackerRun:
        """Return the tracker of one approach."""
