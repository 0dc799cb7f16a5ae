"""`OpenLoopPlan`: a scripted policy that flies plans of an earlier optimisation, each in its own episode."""

from __future__ import annotations

import os
from collections.abc import Iterable
from functools import cached_property

import numpy as np
from pydantic import Field, model_validator

from safe_inspect.errors import SafeInspectError
from safe_inspect.planning.record import FlightPlan, read_record
from safe_inspect.policies.base import ScriptedPolicy, ThrustLimits
from safe_inspect.simulators.view import View
from safe_inspect.types import FloatArray


class OpenLoopPlan(ScriptedPolicy):
    """Fly plans that do not look where the deputy is.

    An episode is known by its random key, a pure function of the run's seed and the environment slot, so that a plan is
    flown in its own episode whatever the batch. Burns that overlap add up.

    Attributes:
        plans: The plan of each episode, by the episode's key in hexadecimal digits. Without any, all deputies coast.
    """

    plans: dict[str, FlightPlan] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _keys(self) -> OpenLoopPlan:
        for key in self.plans:
            try:
                int(key, 16)
            except ValueError:
                raise ValueError(f"the key of an episode is a hexadecimal number, not {key!r}") from None
        return self

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> OpenLoopPlan:
        """Return the policy that flies the plans of a file of ``safe-inspect baseline optimiser``.

        Raises:
            SafeInspectError: The file is missing, damaged or holds no plans.
        """
        record = read_record(path)
        if not any(entry.plan is not None for entry in record.entries):
            raise SafeInspectError(f"{path}: no plans are in it; `safe-inspect baseline optimiser` writes some")
        return cls.of((entry.key, entry.plan) for entry in record.entries)

    @classmethod
    def of(cls, plans: Iterable[tuple[int, FlightPlan | None]]) -> OpenLoopPlan:
        """Return the policy that flies the plan of each episode, given by the episode's key; None coasts."""
        return cls(plans={f"{key:016x}": plan or () for key, plan in plans})

    @cached_property
    def _thrust(self) -> dict[int, dict[int, FloatArray]]:
        """Thrust by episode and step [N]."""
        table: dict[int, dict[int, FloatArray]] = {}
        for key, plan in self.plans.items():
            steps = table.setdefault(int(key, 16), {})
            for burn in plan:
                for step in range(burn.step, burn.step + burn.steps):
                    steps[step] = steps.get(step, np.zeros(3)) + np.array(burn.thrust)
        return table

    def __call__(self, view: View, limits: ThrustLimits) -> FloatArray:
        """Return the thrust that the plan of each row has for its step [N], shape (R, 3).

        Raises:
            SafeInspectError: There is no plan for an episode.
        """
        thrust = np.zeros((view.num_rows, 3))
        if not self.plans:
            return thrust
        keys = view.per_environment(view.state.key).tolist()
        for row, (key, step) in enumerate(zip(keys, view.step.tolist(), strict=True)):
            steps = self._thrust.get(key)
            if steps is None:
                raise SafeInspectError(
                    "an OpenLoopPlan is flown in an episode that it has no plan for; fly the seed and no more episodes "
                    "than it was made for"
                )
            if step in steps:
                thrust[row] = steps[step]
        return thrust
