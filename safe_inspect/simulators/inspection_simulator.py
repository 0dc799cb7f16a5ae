"""`InspectionSimulator`: deputies inspect the lit points of a chief in Clohessy-Wiltshire dynamics."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from safe_inspect.plugin import Plugin
from safe_inspect.simulators.delta_v_scale import DeltaVSchedule
from safe_inspect.simulators.illumination import IlluminationParams
from safe_inspect.units import Angle, PositiveAngularRate, PositiveLength

if TYPE_CHECKING:
    from safe_inspect.rta.team import TeamSafety
    from safe_inspect.simulators.reset import ResetPlan
    from safe_inspect.simulators.simulation import Simulation
    from safe_inspect.simulators.view import Group


class Simulator(Plugin):
    """Configuration of a simulator; called, it gives a running one."""

    kind: ClassVar[str] = "simulator"

    @abstractmethod
    def __call__(
        self,
        *,
        masses: Mapping[str, float],
        groups: Sequence[Group],
        reset: ResetPlan,
        step_size: float,
        num_envs: int,
        seed: int,
        first_slot: int,
        team_guard: TeamSafety | None = None,
    ) -> Simulation:
        """Build the running simulation."""


class InspectionPoints(BaseModel):
    """The points on a body that are to be inspected.

    Attributes:
        num_points: Number of points asked for. ``cmu`` rounds it to whole rings, ``fibonacci`` gives exactly it.
        radius: Radius of the sphere that carries them [m].
        points_algorithm: ``fibonacci`` (a golden-angle lattice) or ``cmu`` (Deserno's rings of equal area).
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    num_points: int = Field(default=100, ge=1, le=100_000)
    radius: PositiveLength = 10.0
    points_algorithm: Literal["fibonacci", "cmu"] = "fibonacci"


class InspectionSimulator(Simulator):
    """One chief, its points, the sun, and deputies that look at the chief.

    Attributes:
        inspection_points_map: Points by the body that carries them.
        illumination_params: The sun's light; None: every point is lit at all times.
        mean_motion: Mean motion of the chief's circular orbit [rad/s].
        field_of_view: Full angle of the camera's cone about the line to the chief's centre [rad].
        steps_until_update: Steps of a slot between two updates of its delta-v scale.
        delta_v_scale_bounds: Smallest and largest scale of the delta-v reward [1/(m/s)]; it starts at the largest.
        delta_v_scale_step: Change of the scale at an update.
        inspected_points_update_bounds: The scale moves back when the mean inspected fraction at the end of an
            episode is at most the first, and on when it is at least the second.
    """

    inspection_points_map: dict[str, InspectionPoints] = Field(default_factory=lambda: {"chief": InspectionPoints()})
    illumination_params: IlluminationParams | None = IlluminationParams()
    mean_motion: PositiveAngularRate = 0.001027
    field_of_view: Angle = math.pi
    steps_until_update: int = Field(default=1500, ge=1)
    delta_v_scale_bounds: tuple[float, float] = (-0.1, -0.001)
    delta_v_scale_step: float = -0.00005
    inspected_points_update_bounds: tuple[float, float] = (0.8, 0.9)

    @model_validator(mode="after")
    def _consistent(self) -> InspectionSimulator:
        for field in ("delta_v_scale_bounds", "inspected_points_update_bounds"):
            low, high = getattr(self, field)
            if not low <= high:
                raise ValueError(f"`{field}` is [low, high], but {low} is above {high}; swap them")
        if not 0.0 < self.field_of_view <= math.pi:
            raise ValueError(f"`field_of_view` is a full angle in (0, pi], not {self.field_of_view} rad")
        return self

    @property
    def schedule(self) -> DeltaVSchedule:
        """How the scale of the delta-v reward moves."""
        return DeltaVSchedule(
            start=self.delta_v_scale_bounds[1],
            bounds=self.delta_v_scale_bounds,
            change=self.delta_v_scale_step,
            steps_until_update=self.steps_until_update,
            fractions=self.inspected_points_update_bounds,
        )

    def __call__(
        self,
        *,
        masses: Mapping[str, float],
        groups: Sequence[Group],
        reset: ResetPlan,
        step_size: float,
        num_envs: int,
        seed: int,
        first_slot: int,
        team_guard: TeamSafety | None = None,
    ) -> Simulation:
        """Build the running simulation of `num_envs` environments.

        Args:
            masses: Mass of each deputy [kg], by platform, in agent order.
            groups: Groups of agents.
            reset: How an episode begins.
            step_size: Length of a step [s].
            num_envs: Number of environments, N.
            seed: Seed of the run.
            first_slot: Global index of the first environment slot.
            team_guard: What filters the thrusts of all deputies together and may declare memory, where there is one.
        """
        from safe_inspect.simulators.simulation import Simulation  # compiles kernels: not when only validated

        return Simulation(
            self,
            platforms=tuple(masses),
            masses=np.array(list(masses.values())),
            groups=groups,
            reset=reset,
            step_size=step_size,
            num_envs=num_envs,
            seed=seed,
            first_slot=first_slot,
            team_guard=team_guard,
        )
