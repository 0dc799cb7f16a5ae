"""The counts of inspected points that plugins and infos get, against the points themselves."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import TeamEnvironment


@pytest.mark.parametrize("task", ["TranslationalInspection-v1", "MultiagentTranslationalInspectionSeed-v0"])
def test_counts_and_fractions_are_those_of_the_points(task: str) -> None:
    environment = TeamEnvironment(load_experiment(f"safe_inspect/{task}").spec, 6, seed=5)
    environment.reset()
    simulation = environment.simulation
    inspector = simulation.state.points["chief"].inspector
    assert (inspector >= 0).any(), "points are inspected at the reset"
    total = (inspector >= 0).sum(axis=1)
    for view in simulation.views:
        points = view.points("chief")
        deputies = len(points.count) // len(total)
        np.testing.assert_array_equal(points.count, total.repeat(deputies))
        np.testing.assert_array_equal(points.fraction, total.repeat(deputies) / inspector.shape[1])
        for component in simulation.components.values():
            info = component.info(view)
            if "inspected_count" in info:
                np.testing.assert_array_equal(info["inspected_count"], total.repeat(deputies))
                own = [(row == deputy).sum() for row in inspector for deputy in range(deputies)]
                np.testing.assert_array_equal(info["own_inspected_count"], own)


def test_new_points_are_those_of_the_step_and_in_the_first_step_those_of_the_reset_too() -> None:
    environment = TeamEnvironment(load_experiment("safe_inspect/TranslationalInspection-v1").spec, 8, seed=5)
    environment.reset()
    points, before = environment.simulation.state.points["chief"], np.zeros(8)
    assert (points.inspector >= 0).any()
    thrust = np.random.default_rng(3).integers(0, 3, (60, 8, 1, 3)).astype(float)
    found = 0
    for step in range(60):
        transition = environment.step([thrust[step]])
        now = (environment.simulation.state.points["chief"].inspector >= 0).sum(axis=1)
        np.testing.assert_array_equal(transition.groups[0].step.new_points("chief"), now - before)
        found, before = found + int((now > before).sum()), now
        if transition.over.any():
            break
    assert found > 4
