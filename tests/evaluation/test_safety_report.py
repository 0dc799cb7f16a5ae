"""The safety report finds nothing under the default filter, and finds what is there under weaker ones."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.config.experiment import load_experiment
from safe_inspect.errors import ConfigError
from safe_inspect.evaluation.safety_report import safety_report
from safe_inspect.figures.drawing import save
from safe_inspect.figures.trajectory_figure import safety_figure
from safe_inspect.rta.adversaries import ADVERSARIES

ON = "RTAGlueCWHInspection1v1.config.enabled=True"
METHOD = "agent_config.blue0_ctrl.config.config.glues.0.config.method"
NAMES = ("chief_collision", "rel_vel", "sun", "r_max", "PSM", "x_vel", "y_vel", "z_vel")


@pytest.fixture(scope="module")
def report_of(shipped):
    """Return a function that flies 6,000 steps under overrides, once each."""
    flown = {}

    def fly(*overrides):
        if overrides not in flown:
            flown[overrides] = safety_report(load_experiment(shipped, overrides).spec, 6000, 60, seed=3)
        return flown[overrides]

    return fly


def test_no_violation_under_the_filter_that_holds(report_of):
    report = report_of(ON)
    assert report.violations == 0
    assert (report.least_at_steps >= 0.0).all()
    assert (report.least_between >= 0.0).all()
    assert report.infeasible == 0
    assert report.starts_refused == 0
    assert report.ends[[1, 2]].sum() == 0
    assert (report.interventions[:-1] > 0.5 * report.flown[:-1]).all()  # all but the one that wants nothing
    assert report.interventions[-1] < 0.05 * report.flown[-1]


@pytest.mark.parametrize("overrides", [(), (ON, f"{METHOD}=continuous")], ids=["off", "continuous"])
def test_it_finds_the_violations_of_what_does_not_hold(report_of, overrides):
    report = report_of(*overrides)
    speed = NAMES.index("rel_vel")
    assert report.violations == report.violations_at_steps.sum() + report.violations_between.sum()
    assert report.violations_at_steps[speed] > 600
    assert report.violations_between[speed] > report.violations_at_steps[speed]  # nine moments in every hold
    np.testing.assert_array_equal(report.least_at_steps < 0.0, report.violations_at_steps > 0)
    np.testing.assert_array_equal(report.least_between < 0.0, report.violations_between > 0)
    assert (report.worst < 0.0).any()
    assert ON in overrides or not report.interventions.any()


def test_off_more_breaks_than_under_the_continuous_form(report_of):
    assert report_of().violations > report_of(ON, f"{METHOD}=continuous").violations
    assert report_of().ends[2] > 0  # crashes, and deputies that left the range


def test_its_counts_agree(report_of, shipped):
    report = report_of(ON)
    assert report.names == NAMES
    assert report.steps == 6000
    assert report.moments == 6000 * 9
    np.testing.assert_array_equal(report.flown, [1000] * len(ADVERSARIES))
    assert (report.interventions <= report.flown).all()
    assert report.worst.shape == (101, 8)
    text = str(report)
    for name in (*NAMES, *ADVERSARIES, "6,000 filtered steps", "54,000 moments", "infeasible steps: 0"):
        assert name in text
    spec = load_experiment(shipped).spec
    told = []
    odd = safety_report(spec, 10, 4, substeps=3, progress=lambda *args: told.append(args))
    assert odd.steps == 12  # whole steps of the batch
    assert odd.moments == 12 * 2
    assert odd.flown.sum() == 12
    assert told == [(4, 12), (8, 12), (12, 12)]
    assert safety_report(spec, 3, 1000).steps == 3


def test_a_seed_repeats_it(shipped):
    spec = load_experiment(shipped).spec
    first, again, other = (safety_report(spec, 300, 30, seed=seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first.worst, again.worst)
    np.testing.assert_array_equal(first.least_between, again.least_between)
    assert not np.array_equal(first.least_between, other.least_between)


def test_its_moments_lie_on_the_trajectory(fixed_start):
    """A deputy that coasts: the smallest range between the steps is that of the closed form."""
    spec = fixed_start((0.0, 60.0, 0.0), (0.0, -0.1, 0.0), 3.0)
    report = safety_report(spec, 6, 6, substeps=10)  # one hold; row 5 wants nothing, row 0 flies to the chief
    chief = NAMES.index("chief_collision")
    # towards the chief with the largest thrust for 9 of 10 seconds (the orbit's terms are below 0.1 m)
    expected = 60.0 - 0.1 * 9.0 - 0.5 / 12.0 * 81.0 - 10.0
    assert report.least_between[chief] == pytest.approx(expected, abs=0.1)
    assert report.least_at_steps[chief] == pytest.approx(60.0 - 1.0 - 50.0 / 12.0 - 10.0, abs=0.1)


def test_the_figure_is_written(report_of, tmp_path):
    for index, report in enumerate((report_of(ON), report_of())):
        figure = safety_figure(report)
        labels = " ".join(axes.get_ylabel() for axes in figure.axes)
        assert all(name in labels for name in NAMES)
        assert {"chief_collision\n[m]", "x_vel\n[m/s]", "sun\n[rad]"} <= {axes.get_ylabel() for axes in figure.axes}
        target = tmp_path / f"{index}.png"
        save(figure, target)
        assert target.read_bytes().startswith(b"\x89PNG")
        assert target.stat().st_size > 10_000


def test_an_agent_without_a_safety_glue_is_refused(shipped):
    glue = "agent_config.0.config.config.glues.0"
    tree = load_experiment(shipped).resolved["agent_config"][0]["config"]["config"]["glues"][0]["wrapped"][0]
    assert tree["functor"] == "ControllerGlue"
    plain = f"{glue}={{functor: ControllerGlue, config: {{controller: X Thrust, normalization: {{enabled: False}}}}}}"
    with pytest.raises(ConfigError, match="'blue0_ctrl' has no safety glue"):
        safety_report(load_experiment(shipped, [plain]).spec, 10, 2)


@pytest.mark.parametrize("numbers", [(0, 2, 1), (2, 0, 1), (2, 2, 0), (-5, 2, 1)])
def test_numbers_that_are_not_positive_are_refused(shipped, numbers):
    steps, num_envs, substeps = numbers
    with pytest.raises(ValueError, match="at least 1"):
        safety_report(load_experiment(shipped).spec, steps, num_envs, substeps=substeps)
