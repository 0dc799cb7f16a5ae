"""Estimation: front ends, back ends, characterisers, and the estimator that they make."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from safe_inspect.plugins.functor import functor_field
from safe_inspect.rendezvous.plugins.base import BackEnd, Characteriser, FrontEnd, StateEstimator
from safe_inspect.units import NonNegativeDuration, PositiveDuration, PositiveLength, quantity

if TYPE_CHECKING:
    from safe_inspect.rendezvous.back_end.options import CentrePrior, ChaserStart
    from safe_inspect.rendezvous.back_end.run import GraphBackEnd
    from safe_inspect.rendezvous.characterise.fit import Motion
    from safe_inspect.rendezvous.characterise.history import History, TargetEstimate
    from safe_inspect.rendezvous.estimation.context import EstimatorContext
    from safe_inspect.rendezvous.estimation.run import PipelineEstimatorRun
    from safe_inspect.rendezvous.front_end.context import FrontEndContext
    from safe_inspect.rendezvous.front_end.measured import MeasuredPosesRun
    from safe_inspect.rendezvous.readings import Reading
    from safe_inspect.rendezvous.sensors.imu import ImuNoise
    from safe_inspect.rendezvous.target.model import Target
    from safe_inspect.types import FloatArray


class MeasuredPoses(FrontEnd):
    """Passes on the poses that the sensor ``sensors.poses`` measures; for tests and ablations in a simulation."""

    reads: ClassVar[Literal["frames", "poses"]] = "poses"

    def __call__(self, context: FrontEndContext) -> MeasuredPosesRun:
        """Return the front end of a mission."""
        from safe_inspect.rendezvous.front_end.measured import MeasuredPosesRun

        return MeasuredPosesRun()


class ISAM2BackEnd(BackEnd):
    """A factor graph that iSAM2 solves: inertial, relative poses, and a centre of mass that rests in W.

    Attributes:
        kinematic_sigma: Of the rotation kinematic factor [m].
        huber: Residual beyond which an edge counts less, in standard deviations.
        relinearise: Change beyond which a variable is linearised anew [rad, m, m/s].
        largest: Number of frames beyond which the older half is replaced by priors.
        memory: Time over which errors of poses to the model stay alike [s]; 0 for independent ones.
    """

    kinematic_sigma: PositiveLength = 0.005  # type: ignore[valid-type]
    huber: float = Field(default=1.345, gt=0.0)
    relinearise: float = Field(default=1e-3, gt=0.0)
    largest: int = Field(default=600, ge=10)
    memory: NonNegativeDuration = 2.0  # type: ignore[valid-type]

    def __call__(self, imu: ImuNoise, period: float, start: ChaserStart, centre: CentrePrior) -> GraphBackEnd:
        """Return the back end of a mission."""
        from safe_inspect.rendezvous.back_end.options import GraphOptions
        from safe_inspect.rendezvous.back_end.run import GraphBackEnd

        options = GraphOptions(
            imu=imu,
            kinematic=self.kinematic_sigma,
            huber=self.huber,
            relinearise=self.relinearise,
            largest=self.largest,
            memory=self.memory,
        )
        return GraphBackEnd(options, period, start, centre)


class PolhodeCharacteriser(Characteriser):
    """Principal axes from the polhode, then a fit of a free rigid body to all measured rotations.

    Attributes:
        span: Least time between two attitudes that give a rate [s].
        window: Window over the rates [s].
        ratios_sigma: How far the logits of the inertia ratios may be from those of the known target; null to leave
            them free where the motion shows them. Where it does not, they are the known target's.
        use_model: Whether poses to the known model, and with them its principal axes, take part in the fit.
        telescoping: Share of an edge's variance that is an error of its frames' views and cancels along a chain.
        memory: Time over which errors of poses to the model stay alike [s].
        drift: What the gyroscopes' bias may be estimated wrong by [rad/s].
        inflation: Factor of the standard deviations, from calibration.
    """

    span: PositiveDuration = 1.0  # type: ignore[valid-type]
    window: PositiveDuration = 5.0  # type: ignore[valid-type]
    ratios_sigma: float | None = Field(default=None, gt=0.0)
    use_model: bool = True
    telescoping: float = Field(default=0.5, ge=0.0, lt=1.0)
    memory: NonNegativeDuration = 6.0  # type: ignore[valid-type]
    drift: quantity("rad/s", ge=0) = 5e-5  # type: ignore[valid-type]
    inflation: float = Field(default=1.0, gt=0.0)

    def __call__(
        self, history: History, target: Target | None, before: Motion | None, model: FloatArray | None
    ) -> TargetEstimate | None:
        """Return how the target tumbles, or None where there is too little to tell."""
        from safe_inspect.dynamics.quaternion import from_matrix
        from safe_inspect.rendezvous.characterise.motion import CharacteriseOptions, characterise

        options = CharacteriseOptions(
            span=self.span,
            window=self.window,
            ratios=None if target is None else target.principal[:2] / target.principal[2],
            ratios_sigma=self.ratios_sigma,
            q_MT=from_matrix(target.R_MT) if target is not None and self.use_model else None,
            telescoping=self.telescoping,
            memory=self.memory,
            drift=self.drift,
            inflation=self.inflation,
        )
        return characterise(history, options, before, model if self.use_model else None)


def _plugin(kind: str, default: str | dict[str, Any]) -> Any:
    return Annotated[functor_field(kind), Field(default=default, validate_default=True)]


class PipelineEstimator(StateEstimator):
    """Knows what depth frames and an inertial unit tell, by a factor graph and a fit of the target's motion.

    Attributes:
        front_end: From frames to relative poses.
        back_end: From relative poses and inertial samples to states.
        characteriser: From the history to the target's motion.
        fit_period: Least time between two fits of the motion [s].
        correlation: Correlation of the errors of two updates that follow each other.
        known_target: Whether the target's shape and inertia are known.
    """

    front_end: _plugin("front_end", "ModelFrontEnd")  # type: ignore[valid-type]
    back_end: _plugin("back_end", "ISAM2BackEnd")  # type: ignore[valid-type]
    characteriser: _plugin("characteriser", "PolhodeCharacteriser")  # type: ignore[valid-type]
    fit_period: PositiveDuration = 5.0  # type: ignore[valid-type]
    correlation: float = Field(default=0.9, ge=0.0, lt=1.0)
    known_target: bool = True

    @property
    def reads(self) -> tuple[Reading, ...]:
        """What it reads of the sensors."""
        return (self.front_end.reads, "inertial")

    def __call__(self, context: EstimatorContext) -> PipelineEstimatorRun:
        """Return the estimator of a mission."""
        from safe_inspect.rendezvous.estimation.pipeline import PipelineParts
        from safe_inspect.rendezvous.estimation.run import PipelineEstimatorRun
        from safe_inspect.rendezvous.front_end.context import FrontEndContext

        target = context.target if self.known_target else None
        parts = PipelineParts(
            front_end=self.front_end(FrontEndContext(context.camera, context.T_BC, target, context.streams)),
            back_end=lambda start, centre: self.back_end(context.imu, context.imu_period, start, centre),
            characterise=self.characteriser,
            target=target,
            T_BC=context.T_BC,
            imu=context.imu,
            fit_period=self.fit_period,
        )
        return PipelineEstimatorRun(context, parts, self.correlation)
