"""The plugins in `examples/rendezvous_package`, which the rendezvous knows nothing of."""

from __future__ import annotations

import importlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from safe_inspect.errors import ConfigError
from safe_inspect.missions.mission import Mission
from safe_inspect.rendezvous.experiment import build_rendezvous, load_rendezvous
from safe_inspect.rendezvous.planner.problem import sampled_plan
from safe_inspect.rendezvous.planner.query import Plan, PlanStatus
from safe_inspect.rendezvous.plugins import ApproachPlanner
from safe_inspect.testing import ContractError, check_plugin

pytest.importorskip("piqp")

_PACKAGE = Path(__file__).parents[2] / "examples" / "rendezvous_package"
_EXPERIMENT = _PACKAGE / "configs" / "direct" / "experiment.yml"
_QUICK = ["mission.checkout=0.4 s", "mission.observe=1 s"]


@pytest.fixture
def package(monkeypatch):
    monkeypatch.syspath_prepend(str(_PACKAGE / "src"))
    return importlib.import_module("safe_inspect_approach")


@pytest.mark.parametrize("name", ["DirectPlanner", "FixedGainEstimator", "ProportionalDerivativeTracker"])
def test_the_plugins_keep_the_contract(package, name):
    check_plugin(getattr(package, name))


@pytest.mark.parametrize("tracker", ["PDTracker", "TubeTracker"])
def test_its_planner_flies_to_the_mating_point(package, tracker):
    config = load_rendezvous(_EXPERIMENT, [*_QUICK, f"tracker={tracker}"]).config
    assert type(config.planner) is package.DirectPlanner
    result = Mission(config).run()
    assert result.summary["success"], result.summary
    plan = result.log.plans[0]
    assert plan.solved
    # It flew the plan, not another one.
    moves = result.log.arrays()["state"] == 6
    # The reference follows the newest estimate, 2 s after the one that the plan was made from.
    assert np.abs(result.log.arrays()["reference"][moves][0, :3] - plan.position[0]).max() < 0.02


@pytest.mark.parametrize("front_end", ["MeasuredPoses", pytest.param("ModelFrontEnd", marks=pytest.mark.slow)])
def test_its_estimator_planner_and_tracker_fly_a_mission_together(package, front_end):
    override = f"estimator.config.front_end={front_end}"
    config = load_rendezvous(_EXPERIMENT.parents[1] / "filter" / "experiment.yml", [override]).config
    assert type(config.estimator) is package.FixedGainEstimator
    result = Mission(config).run()
    assert result.summary["success"], result.summary
    assert result.summary["mating_position_error"] < 0.02
    assert result.summary["least_clearance"] > 0.05


@pytest.mark.usefixtures("package")
def test_names_are_registered_names_or_dotted_paths():
    tree = {"plugin_paths": ["safe_inspect_approach"], "planner": "DirectPlanner"}
    dotted = {"planner": "safe_inspect_approach.DirectPlanner", "tracker": "safe_inspect_approach.tracker.PDTracker"}
    assert build_rendezvous(tree).config.planner == build_rendezvous(dotted | {"tracker": "PDTracker"}).config.planner
    with pytest.raises(ConfigError, match=r"tracker.* has no 'PDTracker'"):
        build_rendezvous(dotted)


def test_a_module_that_is_missing_is_named_with_its_place(tmp_path):
    file = tmp_path / "experiment.yml"
    file.write_text("seed: 0\nplugin_paths: [no_such_module]\nplanner: DirectPlanner\n")
    with pytest.raises(ConfigError, match=r"experiment\.yml:2 plugin_paths\[0\]: .*no_such_module"):
        load_rendezvous(file)


def test_a_planner_that_returns_what_was_not_asked_for_is_refused(package, clean_registry):
    direct = package.DirectPlanner()

    class PathlessPlanner(ApproachPlanner):
        """Forgets its path."""

        def __call__(self, query):
            return replace(direct(query), path=None)

    class CarelessPlanner(ApproachPlanner):
        """Calls solved what leads through the target."""

        def __call__(self, query):
            return sampled_plan(query, package.planner.direct_path(query, 0.0, query.durations[0]))

    class IdlePlanner(ApproachPlanner):
        """Finds nothing."""

        def __call__(self, query):
            return Plan(PlanStatus.NOT_CONVERGED, query.t0, query.durations[0])

    for planner, rule in ((PathlessPlanner(), "plan"), (CarelessPlanner(), "certificate"), (IdlePlanner(), "easy")):
        with pytest.raises(ContractError) as caught:
            check_plugin(planner)
        assert rule in [breach.rule for breach in caught.value.breaches], caught.value
    config = load_rendezvous(_EXPERIMENT, [*_QUICK, "mission.time_limit=20 s"]).config
    result = Mission(config.model_copy(update={"planner": PathlessPlanner()})).run()
    assert not result.summary["success"]
    assert result.summary["detail"] == "the plan has no path; return `sampled_plan(query, path)`"
