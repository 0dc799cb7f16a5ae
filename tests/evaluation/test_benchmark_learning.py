from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.evaluation import Evaluation, rollout

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "learning.py"


@pytest.fixture(scope="module")
def learning():
    found = importlib.util.spec_from_file_location("benchmark_learning", SCRIPT)
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


class Loaded:
    """Replacement of the policies of a checkpoint that records which were requested."""

    def __init__(self):
        self.asked = []

    def __call__(self, policy):
        self.asked.append(policy)
        return lambda observation: np.zeros((len(observation), 3))


@pytest.mark.parametrize(
    ("folder", "overrides", "asked", "fliers"),
    [
        ("translational-inspection", [], [None], 1),
        ("multiagent-translational-inspection", [], ["blue0_ctrl", "blue1_ctrl", "blue2_ctrl"], 3),
        ("multiagent-translational-inspection", ["blue#_ctrl.policy_name=team"], ["team"], 1),
    ],
)
def test_each_policy_of_the_checkpoint_is_loaded_once_and_flies_its_agents(learning, folder, overrides, asked, fliers):
    experiment = load_experiment(configs_root() / folder / "experiment-seed.yml", overrides)
    load = Loaded()
    pilots = learning.pilots(experiment, load)
    assert load.asked == asked
    assert list(pilots) == [agent.name for agent in experiment.spec.agents]
    assert len(set(map(id, pilots.values()))) == fliers
    flown = Evaluation.of("", rollout(experiment.spec, pilots, episodes=2))
    lines = learning.table({"a": flown, "nobody": flown}).splitlines()
    assert len(lines) == 3
    assert ("closest deputies" in lines[0]) == ("delta-v per deputy" in lines[0]) == (len(pilots) > 1)
    assert f"{flown.team.figures['return'].mean():.3f}" in lines[2]
