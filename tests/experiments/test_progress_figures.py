"""The columns of progress.csv, from the raw steps of the environments that a training samples."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable

import numpy as np
import pytest
from algorithms import build

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.experiments.runs.progress import TrainingLog, flatten
from safe_inspect.experiments.settings.policies import DEFAULT_MAKER

HORIZON, WINDOW, ENVS, POINTS = 20, 25, 16, 2
TASKS = {"one": "translational-inspection", "three": "multiagent-translational-inspection"}
OVERRIDES = (f"horizon={HORIZON}", f"simulator.config.inspection_points_map.chief.num_points={POINTS}")


class RawSteps:
    """Adds up what every step of every environment gives; keeps the episodes that have ended, in order."""

    def __init__(self) -> None:
        self.taken = 0
        self.ended: list[dict[str, float]] = []
        self._sums: dict[int, dict[str, float]] = {}
        self._running: dict[int, np.ndarray] = {}
        self._left: dict[int, bool] = {}

    def add(self, environment: TeamEnvironment, transition) -> None:
        """Add a step of every environment."""
        agents = [name for group in environment.groups for name in group.agents]
        reward = np.concatenate([group.reward for group in transition.groups], axis=1)
        terminated = np.concatenate([group.terminated for group in transition.groups], axis=1)
        truncated = np.concatenate([group.truncated for group in transition.groups], axis=1)
        control = np.concatenate(
            [group.step.control.reshape(*group.reward.shape, 3) for group in transition.groups], axis=1
        )
        spent = np.abs(control).sum(axis=2) * 10.0 / 12.0
        terms = {
            name: np.concatenate([group.terms[name] for group in transition.groups], axis=1)
            for name in transition.groups[0].terms
        }
        self.taken += environment.num_envs
        for row in range(environment.num_envs):
            sums = self._sums.setdefault(row, {})
            running = self._running.setdefault(row, np.ones(len(agents), bool))

            def count(name: str, value: float, sums: dict[str, float] = sums) -> None:
                sums[name] = sums.get(name, 0.0) + float(value)

            count("length", 1.0)
            for k, agent in enumerate(agents):
                for name, value in {"return": reward[row, k], "delta_v": spent[row, k], "length": running[k]}.items():
                    count(f"agents/{agent}/{name}", value)
                for name, value in terms.items():
                    count(f"agents/{agent}/reward/{name}", value[row, k])
                if running[k] and (terminated[row, k] or truncated[row, k]):
                    running[k] = False
                    inspected = (environment.state.points["chief"].inspector[row] >= 0).sum()
                    lost = self._loses(environment.state.position[row, : len(agents)], k)
                    sums[f"agents/{agent}/lost"] = float(lost)
                    sums[f"agents/{agent}/success"] = float(inspected == POINTS and not lost)
            if not running.any():
                self._end(environment, row, agents)

    @staticmethod
    def _loses(position: np.ndarray, deputy: int) -> bool:
        """Return whether a deputy is too near, too far, or any two have collided."""
        apart = [math.dist(a, b) for i, a in enumerate(position) for b in position[:i]]
        distance = math.hypot(*position[deputy])
        return distance < 10.0 or distance > 800.0 or min(apart, default=math.inf) < 10.0

    def _end(self, environment: TeamEnvironment, row: int, agents: list[str]) -> None:
        sums = self._sums.pop(row)
        self._running.pop(row)
        inspector = environment.state.points["chief"].inspector[row]
        for k, agent in enumerate(agents):
            sums[f"agents/{agent}/inspected_count"] = float((inspector == k).sum())

        def of_agents(name: str) -> list[float]:
            return [sums[f"agents/{agent}/{name}"] for agent in agents]

        sums["inspected_count"] = float((inspector >= 0).sum())
        sums["inspected_fraction"] = sums["inspected_count"] / POINTS
        sums["lost_rate"] = float(any(of_agents("lost")))
        sums["success_rate"] = float(any(of_agents("success")) and not sums["lost_rate"])
        sums["return"], sums["delta_v"] = sum(of_agents("return")), float(np.mean(of_agents("delta_v")))
        for name in [name for name in sums if name.startswith(f"agents/{agents[0]}/reward/")]:
            term = name.removeprefix(f"agents/{agents[0]}/")
            sums[term] = sum(of_agents(term))
        if len(agents) == 1:
            sums = {name: value for name, value in sums.items() if not name.startswith("agents/")}
        self.ended.append(sums)


@pytest.fixture
def raw(monkeypatch) -> RawSteps:
    """Return the raw steps of all environments."""
    steps, step = RawSteps(), TeamEnvironment.step

    def counted(environment, actions):
        transition = step(environment, actions)
        steps.add(environment, transition)
        return transition

    monkeypatch.setattr(TeamEnvironment, "step", counted)
    return steps


def row_of_raw(ended: list[dict[str, float]]) -> dict[str, float]:
    """Return the columns of an iteration: over its last episodes, as many as RLlib smooths over."""
    recent = ended[-WINDOW:]
    if not recent:
        return {}
    row = {name: math.fsum(one[name] for one in recent) / len(recent) for name in recent[0]}
    returns = [one["return"] for one in recent]
    row |= {"return_mean": row.pop("return"), "return_min": min(returns), "return_max": max(returns)}
    row["length_mean"] = row.pop("length")
    return row


def rows_in(folder) -> list[dict[str, str]]:
    with (folder / "progress.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def same_row(found: dict[str, str], expected: dict[str, float], others: Callable[[str], bool]) -> None:
    """Compare the cells of a row; `others` says which columns are of something else."""
    cells = {name: float(cell) for name, cell in found.items() if cell and not others(name)}
    assert cells.keys() == expected.keys()
    for name, value in expected.items():
        assert cells[name] == pytest.approx(value, rel=1e-9, abs=1e-12), name


@pytest.mark.slow
@pytest.mark.parametrize("task", TASKS)
def test_the_columns_of_a_training(raw, tmp_path, task):
    """What a training's runner logs, through RLlib's logger, to the file; before the second row no episode ends."""
    from ray.rllib.utils.metrics.metrics_logger import MetricsLogger

    from safe_inspect.experiments.sampling.env_runners import BatchedEnvRunner, BatchedTeamRunner

    experiment = load_experiment(configs_root() / TASKS[task] / "experiment-seed.yml", OVERRIDES)
    config = build(
        experiment.resolved, DEFAULT_MAKER, tuple(experiment.policies.values()), seed=7,
        model_config={"fcnet_hiddens": [16, 16], "initial_std": 0.25}, num_envs_per_env_runner=ENVS,
        metrics_num_episodes_for_smoothing=WINDOW,
    )  # fmt: skip
    runner = (BatchedEnvRunner if task == "one" else BatchedTeamRunner)(config=config)
    logger, log, expected, episodes = MetricsLogger(root=True), TrainingLog(tmp_path), [], 0
    for iteration, steps in enumerate((40, 0, 30, 60), 1):
        if steps:
            runner.sample(num_timesteps=steps * ENVS)
        logger.aggregate([runner.get_metrics()], key="env_runners")
        found = flatten(logger.reduce())
        lifetime = "num_env_steps_sampled_lifetime"
        log.add(found | {"training_iteration": iteration, lifetime: found[f"env_runners/{lifetime}"]})
        episodes += len(raw.ended)
        row = row_of_raw(raw.ended) | {"iteration": iteration, "episodes": episodes, "steps": raw.taken}
        expected.append((len(raw.ended), row))
        raw.ended = []
    log.close()
    assert min(count for count, _ in expected) == 0
    assert max(count for count, _ in expected) > WINDOW
    rates = {name: [row.get(name, 0.0) for _, row in expected] for name in ("success_rate", "lost_rate")}
    assert all(any(0.0 < rate < 1.0 for rate in values) for values in rates.values())
    assert any(0.0 < sum(pair) < 1.0 for pair in zip(*rates.values(), strict=True)), "some episodes run out of time"
    for found, (_, row) in zip(rows_in(tmp_path), expected, strict=True):
        same_row(found, row, lambda name: False)
