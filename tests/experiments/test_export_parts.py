"""How an exported file is compared with its checkpoint, in parts that need no file; model cards and first weights."""

from __future__ import annotations

import dataclasses
import math
from datetime import date
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from model_cards import CardData, model_card
from random_checkpoint import LEVELS, discrete, experiment_of, scaled

from safe_inspect.config.data import configs_root
from safe_inspect.config.elements import element_columns
from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments.layout import action_layout
from safe_inspect.evaluation.onnx_policy import OnnxPolicy
from safe_inspect.experiments.runs.training_run import TrainingRun, read_settings, unfit_policies, unfit_weights
from safe_inspect.experiments.settings.policies import policy_info
from safe_inspect.version import __version__

pytestmark = pytest.mark.ray


@pytest.mark.parametrize(
    ("action", "inputs", "passes"),
    [(0.0, 0.0, True), (1e-5, 1e-5, True), (1.01e-5, 0.0, False), (0.0, 1.01e-5, False), (math.nan, 0.0, False),
     (0.0, math.nan, False)],
)  # fmt: skip
def test_a_file_passes_whose_outputs_are_the_checkpoints(action: float, inputs: float, passes: bool) -> None:
    from safe_inspect.experiments.export import ExportDifference

    assert ExportDifference(9, action, inputs).passes is passes


def _policy(change: Any) -> tuple[Any, Any]:
    experiment = experiment_of(change)
    (agent,) = experiment.spec.agents
    return OnnxPolicy("a.onnx", policy_info(experiment, "default_policy", [agent]), None), agent


def test_readings_are_all_over_what_the_net_sees() -> None:
    from safe_inspect.experiments.export import random_readings

    policy, agent = _policy(scaled)
    readings = random_readings(agent, policy.info, 20, 100, seed=4)
    assert readings.shape[:2] == (20, 100)
    assert readings.dtype == np.float32
    np.testing.assert_array_equal(readings, random_readings(agent, policy.info, 20, 100, seed=4))
    assert not np.array_equal(readings, random_readings(agent, policy.info, 20, 100, seed=5))
    columns = {name: element_columns(policy.info.observation, name) for name in ("centre", "width")}
    seen = (readings.reshape(2000, -1) - columns["centre"]) / columns["width"]
    first = 0
    for glue in agent.observation_glues:
        low, high = glue.bounds(agent.parts)
        part = seen[:, first : first + len(low)]
        for column, (least, largest) in enumerate(zip(low, high, strict=True)):
            if np.isfinite(least) and np.isfinite(largest):
                assert part[:, column].min() >= least - 1e-4 * abs(least)
                assert part[:, column].max() <= largest + 1e-4 * abs(largest)
                assert np.ptp(part[:, column]) > 0.97 * (largest - least)
            else:
                assert part[:, column].std() == pytest.approx(1.0, rel=0.1)
        first += len(low)
    assert first == seen.shape[1] == readings.shape[2]


def test_the_mean_of_numbers_is_commanded_within_their_limits() -> None:
    from safe_inspect.experiments.export import _commanded

    policy, agent = _policy(scaled)
    means = np.array([[0.5, -0.25, 0.125], [9.0, 9.0, 9.0], [-9.0, -9.0, -9.0]])
    inputs = np.concatenate([means, np.full((3, 3), 7.0)], axis=1).astype(np.float32)
    value = _commanded(policy, np.zeros_like(inputs), inputs)
    layout = action_layout(agent)
    clipped = np.clip(means, layout.low, layout.high)
    # Normalised thrusts are -2 to 2 for the limits -1 and 1 N, -1 to 1 for -0.5 and 2 N, and (thrust - 0.1 N) / 0.5 N.
    wanted = np.stack([0.5 * clipped[:, 0], 0.75 + 1.25 * clipped[:, 1], 0.1 + 0.5 * clipped[:, 2]], axis=1)
    np.testing.assert_allclose(value, wanted, rtol=1e-6)


def test_the_largest_logit_of_the_file_chooses_a_level() -> None:
    from safe_inspect.experiments.export import _commanded

    policy, _ = _policy(discrete)
    one = [0.0, 0.0, 3.0, 1.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 9.0]
    equal = [*one[:4], 5.0, 5.0, *one[6:]]
    module = np.array([one, one[::-1]], np.float32)
    value = _commanded(policy, np.array([one, equal], np.float32), module)
    first = LEVELS[1:4]
    np.testing.assert_allclose(value, [[first[2], LEVELS[1], LEVELS[4]]] * 2)


def test_a_hurdle_policy_coasts_where_its_logit_is_not_above_zero() -> None:
    from safe_inspect.experiments.export import _commanded

    policy, _ = _policy(None)
    policy = OnnxPolicy("a.onnx", dataclasses.replace(policy.info, distribution="hurdle"), None)
    module = np.array([[9.0, 0.5, -0.5, 0.25, 7.0, 7.0, 7.0]] * 5, np.float32)
    file = module.copy()
    file[:, 0] = 2.0, -2.0, 0.0, 0.5e-5, -0.5e-5
    value = _commanded(policy, file, module)
    np.testing.assert_allclose(value, [[0.5, -0.5, 0.25] if gate > 0.0 else [0.0] * 3 for gate in file[:, 0]])


CARD = CardData(
    name="docker", title="It docks.", command="safe-inspect train x.yml",
    machine="a machine",
    evaluations={
        "Here": {
            "episodes": 1000, "seed": 7,
            "success": {"rate": 0.5, "interval": [0.25, None], "statuses": {"win": 500, "lose": 500}},
            "figures": {"delta-v": {"mean": 1.23456, "standard_deviation": 0.5, "iqm": None, "iqm_interval": [1.0, 2.0],
                                    "unit": "m/s"}},
            "agents": {
                "red": {"success": {"rate": 1.0, "interval": [0.9, 1.0], "statuses": {"win": 1}}, "figures": {}},
            },
        }
    },
    seeds=["seed 4: 90 %"], limits=["Not at night."],
)  # fmt: skip
TRAINING = {
    "seed": 3, "steps": 1_234_567, "iteration": 9, "seconds": 93.0, "started": "then", "trained_by": "1.2",
    "git_commit": "0123456789abcdef+",
}  # fmt: skip
FILE: Any = SimpleNamespace(
    path=Path("p.onnx"), difference=SimpleNamespace(action=1e-7, rows=1234),
    info=SimpleNamespace(agents=("a", "b|c"), action=[SimpleNamespace(levels=())], observation=["x [m]", "y"]),
)  # fmt: skip
TEXT = """\
# docker

It docks.

## Use

```sh
safe-inspect evaluate --policy docker
```

## Training

```sh
safe-inspect train x.yml
```

|  |  |
|---|---|
| seed | 3 |
| environment steps | 1,234,567 |
| iterations | 9 |
| wall time | 1.6 min |
| machine | a machine |
| begun | then |
| trained by | safe_inspect 1.2, commit 0123456789ab, with uncommitted changes |
| exported | {exported} |

`experiment.resolved.yml` next to this card contains the whole experiment.

Other seeds of the same recipe:

- seed 4: 90 %

## Evaluation

### Here

1,000 episodes, seed 7.

Success 50.0 % (95 % interval 25 to - %; win 500, lose 500).

| figure | mean | std | IQM | 95 % interval of the IQM | unit |
|---|---|---|---|---|---|
| delta-v | 1.235 | 0.5 | - | 1 to 2 | m/s |

red: success 100.0 % (95 % interval 90 to 100 %; win 1).

| figure | mean | std | IQM | 95 % interval of the IQM | unit |
|---|---|---|---|---|---|

## Files

| file | agents | action | largest difference from the checkpoint |
|---|---|---|---|
| p.onnx | a, b\\|c | mean | 1.0e-07 of the range, 1,234 observations |

`p.onnx` reads, in this order: `x [m]`, `y`.

## Limits of use

- Not at night.
"""


def test_the_text_of_a_model_card(monkeypatch: pytest.MonkeyPatch) -> None:
    import model_cards

    monkeypatch.setattr(model_cards, "_PACKAGES", ("numpy",))
    exported = f"{date.today()} by safe_inspect {__version__}, numpy {np.__version__}"
    assert model_card(CARD, TRAINING, [FILE]).startswith(TEXT.replace("{exported}", exported))
    bare = model_card(dataclasses.replace(CARD, evaluations={}, seeds=(), limits=()), {}, [])
    for line in ("| environment steps | unknown |", "| wall time | unknown |", "| seed | unknown |",
                 "| trained by | safe_inspect unknown, commit unknown |", "There is no evaluation."):  # fmt: skip
        assert line in bare.splitlines()
    assert "Other seeds" not in bare
    assert "| trained by | safe_inspect unknown, commit abc |" in model_card(CARD, {"git_commit": "abc"}, [])


@pytest.mark.parametrize(
    ("folder", "overrides", "shown"),
    [
        ("translational-inspection", ["initial_weights=translational-inspection"], []),
        ("docking", [], []),
        ("docking", ["policy.config.model_config.initial_weights=translational-inspection"],
         [("rllib_configs", "translational-inspection: its weights do not match this policy: of the actions, ")]),
        ("multiagent-translational-inspection", [], []),
        ("multiagent-translational-inspection", ["initial_weights=docking"],
         [(f"policies.blue{index}_ctrl", "docking: its weights do not match this policy: of the actions, ")
          for index in range(3)]),
    ],
)  # fmt: skip
def test_weights_that_do_not_fit_their_policy_are_reported(
    folder: str, overrides: list[str], shown: list[tuple[str, str]]
) -> None:
    experiment = load_experiment(configs_root() / folder / "experiment.yml", overrides)
    rllib = {"algorithm": experiment.algorithm, **experiment.rllib}
    settings = read_settings(rllib, {}, {}, tuple(experiment.policies.values()))
    found = unfit_weights(experiment, settings)
    if folder.startswith("multi") and shown:
        assert {problem.path.rpartition(".model_config")[0] for problem in found} <= {"rllib_configs", *dict(shown)}
        assert len(found) == 3
    else:
        assert [problem.path for problem in found] == [f"{where}.model_config.initial_weights" for where, _ in shown]
    for problem in found:
        assert problem.message.startswith(shown[0][1])


def test_agents_with_other_observations_cannot_share_a_policy() -> None:
    path = configs_root() / "multiagent-translational-inspection" / "experiment.yml"
    experiment = load_experiment(path, ["blue#_ctrl.policy_name=shared"])
    settings = read_settings({"algorithm": "PPO"}, {}, {}, tuple(experiment.policies.values()))
    assert not unfit_policies(experiment, settings)
    first, *others = experiment.spec.agents
    narrow = dataclasses.replace(first, glues=tuple(x for x in first.glues if x is not first.observation_glues[-1]))
    spec = dataclasses.replace(experiment.spec, agents=(narrow, *others))
    found = unfit_policies(dataclasses.replace(experiment, spec=spec), settings)
    assert [problem.path for problem in found] == ["policies.shared"] * 2
    assert "blue0_ctrl and blue2_ctrl share the policy shared, but their observations differ" in found[1].message


def test_what_a_training_is_unless_more_is_given() -> None:
    run = TrainingRun({})
    assert (run.rllib, run.tune, run.ray, run.name, str(run.output), run.resume, run.maker) == (
        {}, {}, {}, "training", "output", None, "",
    )  # fmt: skip
    settings = read_settings({}, {}, {})
    assert (settings.single, settings.suggested, len(settings.trials)) == (True, False, 1)
    several = read_settings({"lr": {"grid_search": [1e-3]}}, {}, {})
    assert (several.single, len(several.trials)) == (False, 1)
    assert read_settings({}, {"num_samples": 2}, {}).single is False
    asked = read_settings({"lr": {"grid_search": [1e-3]}}, {"search_alg": "a.B"}, {})
    assert asked.suggested
    assert [problem.path for problem in asked.problems] == ["rllib_configs.lr"]
