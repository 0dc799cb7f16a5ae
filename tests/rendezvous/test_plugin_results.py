"""What a mission does with results of plugins that are no such results."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from safe_inspect.errors import ConfigError, PluginValueError
from safe_inspect.missions.mission import Mission, MissionResult
from safe_inspect.missions.scenario import checked_target
from safe_inspect.rendezvous.control.design import design_without_tube
from safe_inspect.rendezvous.control.tracker import TrackerOutput
from safe_inspect.rendezvous.estimate import StateEstimate
from safe_inspect.rendezvous.experiment import RendezvousConfig, load_rendezvous
from safe_inspect.rendezvous.plugins import EnvisatTarget, LQRTracker, MeasuredState

from .test_experiment import SHIPPED


def _config(**plugins: Any) -> RendezvousConfig:
    limits = [
        "mission.checkout=0.2 s",
        "mission.observe=0 s",
        "mission.wait_limit=0 s",
        "mission.retreat_limit=1 s",
        "mission.departure_limit=1 s",
    ]
    return load_rendezvous(SHIPPED, ["estimator=MeasuredState", *limits]).config.model_copy(update=plugins)


def _fly(**plugins: Any) -> MissionResult:
    return Mission(_config(**plugins)).run()


class _Estimator:
    """Changes the estimates of `MeasuredState` from a time on."""

    reads = ("state",)

    def __init__(self, change: Callable[[StateEstimate], Any], start: float = 0.0) -> None:
        self._change, self._start = change, start

    def known(self, target: Any) -> Any:
        return target

    def __call__(self, context: Any) -> Any:
        self._run = MeasuredState()(context)
        return self

    def update(self, readings: Any) -> Any:
        estimate = self._run.update(readings)
        return estimate if readings.time < self._start else self._change(estimate)


class _Tracker:
    def __init__(self, result: Any) -> None:
        self._result = result

    def design(self, request: Any) -> Any:
        return design_without_tube(request)

    def __call__(self, design: Any) -> Any:
        return self

    def step(self, estimate: Any, reference: Any, k: int) -> Any:
        return self._result


def _moved(position: Any) -> Callable[[StateEstimate], StateEstimate]:
    return lambda estimate: replace(estimate, chaser=estimate.chaser._replace(position=position))


def _output(value: Any) -> _Tracker:
    return _Tracker(TrackerOutput(value, np.zeros(3)))


NO_DESIGN = SimpleNamespace(design=lambda request: None)


@pytest.mark.parametrize(
    ("plugins", "message"),
    [
        ({"planner": lambda query: None}, "returned None; it must return a Plan"),
        ({"tracker": NO_DESIGN}, ".design returned None; it must return a TubeDesign"),
        (
            {"estimator": _Estimator(lambda estimate: None)},
            "_Estimator.update returned None; it must return a StateEst",
        ),
        ({"estimator": _Estimator(_moved(np.zeros(2)))}, r"shape \(2,\) as chaser.position; .* shape \(3,\)"),
        ({"tracker": _Tracker(np.zeros(3))}, "_Tracker.step returned array.*; it must return a TrackerOutput"),
        ({"tracker": _output([0, 0, 0])}, r"_Tracker.step returned \[0, 0, 0\] as force; it must be an array"),
        ({"tracker": _output(np.full(3, np.nan))}, r"_Tracker.step returned the force \[nan nan nan\] at "),
    ],
)
def test_a_result_of_another_type_or_shape_names_the_call(plugins: dict[str, Any], message: str) -> None:
    with pytest.raises(PluginValueError, match=message):
        _fly(**{"tracker": LQRTracker(), **plugins})


@pytest.mark.parametrize("result", [None, replace(EnvisatTarget()(), mating_point=[0.25, 0, 0.42])])
def test_a_target_of_another_type_is_refused(result: Any) -> None:
    with pytest.raises(ConfigError, match=r"target.config: function.__call__ returned"):
        checked_target(_config(target=lambda: result))


def test_an_estimator_that_reads_what_there_is_not_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(MeasuredState, "reads", property(lambda self: ("frame",)))
    with pytest.raises(ValueError, match="its `reads` has 'frame'; it must be a tuple of frames, poses"):
        RendezvousConfig(estimator=MeasuredState())


def test_a_mission_without_a_finite_estimate_ends() -> None:
    result = _fly(estimator=_Estimator(_moved(np.full(3, np.nan)), start=1.0))
    assert result.summary["cause"] == "estimate not finite"
    assert result.summary["time"] < 5.0
    assert all(np.isfinite(result.log.arrays()[name]).all() for name in ("x", "force", "torque"))
