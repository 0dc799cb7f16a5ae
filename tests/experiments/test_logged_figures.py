"""What runners log of their steps and episodes: every figure under its name, computed a second time by hand."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from safe_inspect.config.keys.run_keys import COMPILING
from safe_inspect.dones.base import DoneStatus
from safe_inspect.experiments.sampling.rollout import Rollout
from safe_inspect.experiments.sampling.sampler import episode_reports
from safe_inspect.experiments.settings.policies import environment_settings, experiment_in

pytestmark = pytest.mark.ray


class Logger:
    """Keeps what is logged, as RLlib's `MetricsLogger` is shown it."""

    def __init__(self) -> None:
        self.logged: dict[Any, tuple[float, dict[str, Any]]] = {}

    def log_value(self, key: Any, value: float, **how: Any) -> None:
        assert key not in self.logged
        self.logged[key] = value, how


def config_of(smoothing: int, runners: int = 0) -> Any:
    return SimpleNamespace(metrics_num_episodes_for_smoothing=smoothing, num_env_runners=runners)


def rollout_of_two() -> Rollout:
    """Return 6 steps of 2 environments with 2 agents: in the first the episode ends at 4, one agent of it at 2."""
    rollout = Rollout([(2, 1, 1, 2)], 6, np.zeros(2, dtype=np.int64), np.ones((2, 2), dtype=np.bool_))
    no = np.zeros((2, 2), dtype=np.bool_)
    first, second = no.copy(), no.copy()
    first[1, 0] = second[0, 0] = True
    rollout.end(slice(2), 1, first, no)
    rollout.end(slice(2), 3, no, second)
    rollout.finish(0, 4, 0)
    rollout.close(6)
    return rollout


SLOTS = (SimpleNamespace(agent="red", policy="shared"), SimpleNamespace(agent="blue", policy="own"))


@pytest.mark.parametrize("several", [True, False])
def test_steps_are_counted_for_environments_agents_and_policies(several: bool) -> None:
    from safe_inspect.experiments.sampling.env_runners import log_steps

    logger, rollout = Logger(), rollout_of_two()
    assert log_steps(logger, rollout, SLOTS if several else SLOTS[:1], 3, several) == 12
    # Environment 0 flies steps 0 to 4 and 4 to 6, environment 1 all six; agent 1 ends after two steps of the first.
    counts = {"red": 12, "blue": 10}
    expected: dict[Any, Any] = {
        "num_env_steps_sampled": (12, {"reduce": "sum"}),
        "num_env_steps_sampled_lifetime": (12, {"reduce": "lifetime_sum", "with_throughput": True}),
        "num_episodes": (3, {"reduce": "sum"}),
        "num_episodes_lifetime": (3, {"reduce": "lifetime_sum"}),
    }
    for slot in SLOTS if several else SLOTS[:1]:
        agent = slot.agent if several else "default_agent"
        for kind, name in (("agent", agent), ("module", slot.policy)):
            expected[f"num_{kind}_steps_sampled", name] = counts[slot.agent], {"reduce": "sum"}
            expected[f"num_{kind}_steps_sampled_lifetime", name] = counts[slot.agent], {"reduce": "lifetime_sum"}
    assert logger.logged == expected


def reports() -> list[dict[str, float]]:
    return [
        {"return": 1.0, "length": 10, "seconds": 0.5, "agents/red/return": 0.25, "agents/blue/return": 0.75,
         "agents/red/length": 4, "agents/blue/length": 10, "success_rate": 1.0},
        {"return": -3.0, "length": 30, "seconds": 1.5, "agents/red/return": -1.0, "agents/blue/return": -2.0,
         "agents/red/length": 30, "agents/blue/length": 20, "success_rate": 0.0, "reward/x": 2.0},
        {"return": 5.0, "length": 20, "seconds": 4.0, "agents/red/return": 4.0, "agents/blue/return": 1.0,
         "agents/red/length": 20, "agents/blue/length": 6, "success_rate": 1.0, "reward/x": 4.0},
    ]  # fmt: skip


def test_episodes_of_one_agent_are_logged_with_their_window() -> None:
    from safe_inspect.experiments.sampling.env_runners import log_episodes

    logger = Logger()
    log_episodes(logger, config_of(2), reports(), SLOTS[:1], False)  # the last two count
    expected = {
        "episode_return_mean": (1.0, "mean"), "episode_return_min": (-3.0, "min"), "episode_return_max": (5.0, "max"),
        "episode_len_mean": (25.0, "mean"), "episode_len_min": (20, "min"), "episode_len_max": (30, "max"),
        "episode_duration_sec_mean": (2.75, "mean"),
        ("agent_episode_return_mean", "default_agent"): (1.0, "mean"),
        ("module_episode_return_mean", "default_policy"): (1.0, "mean"),
    }  # fmt: skip
    assert logger.logged == {key: (value, {"reduce": how, "window": 2}) for key, (value, how) in expected.items()}


def test_episodes_of_several_agents_are_logged_for_each_and_for_each_policy() -> None:
    from safe_inspect.experiments.sampling.env_runners import log_episodes

    logger = Logger()
    slots = (*SLOTS, SimpleNamespace(agent="green", policy="shared"))
    shown = [{**report, "agents/green/return": 10.0, "agents/green/length": 1} for report in reports()]
    log_episodes(logger, config_of(100), shown, slots, True)
    found = {key: value for key, (value, _) in logger.logged.items() if isinstance(key, tuple)}
    assert found == {
        ("agent_episode_returns_mean", "red"): pytest.approx(3.25 / 3), ("agent_steps", "red"): 18.0,
        ("agent_episode_returns_mean", "green"): 10.0, ("agent_steps", "green"): 1.0,
        ("agent_episode_returns_mean", "blue"): pytest.approx(-0.25 / 3), ("agent_steps", "blue"): 12.0,
        ("module_episode_returns_mean", "shared"): pytest.approx(10.0 + 3.25 / 3),
        ("module_episode_returns_mean", "own"): pytest.approx(-0.25 / 3),
    }  # fmt: skip
    assert {how["window"] for _, how in logger.logged.values()} == {100}


def test_other_figures_of_episodes_are_means_of_those_that_have_them() -> None:
    from safe_inspect.experiments.sampling.env_runners import log_reports

    logger = Logger()
    log_reports(logger, config_of(2), reports())
    assert logger.logged.keys() == {
        ("success_rate",), ("reward", "x"),
        *(("agents", agent, name) for agent in ("red", "blue") for name in ("return", "length")),
    }  # fmt: skip
    assert logger.logged["success_rate",] == (0.5, {"reduce": "mean", "window": 2})
    assert logger.logged["reward", "x"][0] == 3.0
    assert logger.logged["agents", "red", "length"][0] == 25.0
    wide = Logger()
    log_reports(wide, config_of(9), reports())
    assert wide.logged["reward", "x"][0] == 3.0  # of the two that have it
    assert wide.logged["success_rate",][0] == pytest.approx(2 / 3)


@pytest.mark.parametrize(
    ("smoothing", "runners", "window"), [(100, 0, 100), (100, 1, 100), (100, 3, 34), (4, 4, 1), (2, 8, 1), (1, 0, 1)]
)
def test_each_runner_keeps_its_part_of_the_window(smoothing: int, runners: int, window: int) -> None:
    from safe_inspect.experiments.sampling.env_runners import window_of

    assert window_of(config_of(smoothing, runners)) == window


class Sums:
    """Replacement of the `EpisodeAccumulator` of 3 environments with 3 agents, of which the last is scripted."""

    returns = np.array([[1.0, 2.0, 90.0], [3.0, 5.0, 90.0], [-1.0, 0.5, 90.0]])
    lengths = np.array([[4, 7, 9], [2, 1, 1], [5, 6, 3]])
    filtered = True

    def info(self, rows: Any) -> dict[str, Any]:
        return {"inspected_count": np.array([10.0, 20.0, 30.0])[rows]}

    def terms(self, rows: Any) -> dict[str, Any]:
        return {"reward/x": np.array([0.5, 1.5, 2.5])[rows]}

    def agents(self, rows: Any) -> dict[str, Any]:
        status = np.array([DoneStatus.WIN, DoneStatus.LOSE, DoneStatus.RUNNING])[rows]
        seen, points = np.array([7.0, 8.0, 9.0])[rows], np.array([1.0, 2.0, 3.0])[rows]
        return {"red": {"return": self.returns[rows, 0], "status": status, "own_seen": seen, "info/points": points}}


def test_the_report_of_an_episode_sums_over_agents_and_averages_over_deputies() -> None:
    state = SimpleNamespace(
        delta_v=np.array([[1.0, 3.0], [2.0, 6.0], [0.0, 1.0]]), interventions=np.array([[1, 3], [0, 0], [4, 6]])
    )
    acting = [SimpleNamespace(first=0, size=2)]
    outcome = np.array([DoneStatus.WIN, DoneStatus.RUNNING, DoneStatus.LOSE])
    environment: Any = SimpleNamespace(state=state, acting=acting)
    sums: Any = Sums()
    transition: Any = SimpleNamespace(outcome=outcome)
    first, second = episode_reports(environment, sums, [2, 0], transition)
    assert {key: value for key, value in first.items() if key.startswith("agents/")} == {
        "agents/red/return": -1.0, "agents/red/success": 0.0, "agents/red/lost": 0.0, "agents/red/seen": 9.0,
        "agents/red/points": 3.0,
    }  # fmt: skip
    own = {key: value for key, value in first.items() if not key.startswith("agents/")}
    assert own == {
        "return": -0.5, "length": 6.0, "success_rate": 0.0, "lost_rate": 1.0, "delta_v": 0.5, "inspected_count": 30.0,
        "interventions": 5.0, "reward/x": 2.5,
    }  # fmt: skip
    assert all(isinstance(value, float) for value in first.values())
    assert (second["return"], second["length"], second["success_rate"], second["lost_rate"]) == (3.0, 9.0, 1.0, 0.0)
    assert (second["agents/red/success"], second["agents/red/lost"]) == (1.0, 0.0)
    sums.filtered, sums.returns = False, Sums.returns[:, :1]
    acting[0].size = 1
    (alone,) = episode_reports(environment, sums, [1], transition)
    assert set(alone) == set(own) - {"interventions"}
    assert alone["return"] == 3.0


@pytest.mark.parametrize(("seed", "expected"), [({}, 0), ({"seed": None}, 0), ({"seed": 7}, 7), ({"seed": 0}, 0)])
def test_the_environments_get_experiment_seed_and_threads(seed: dict[str, Any], expected: int) -> None:
    experiment = {"lr": {"grid_search": [1, 2]}}
    found = environment_settings(experiment, {"torch_num_threads": 3, **seed}, maker="x:y")
    assert found == {
        "experiment": '{"lr": {"grid_search": [1, 2]}}', "seed": expected, "torch_num_threads": 3, "maker": "x:y",
    }  # fmt: skip
    assert experiment_in(found) == experiment
    assert experiment_in({"experiment": experiment}) is experiment


@pytest.mark.parametrize("checkpoint", [None, "there", "gone"])
def test_a_run_begins_with_its_threads_and_its_checkpoint(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, checkpoint: str | None
) -> None:
    import torch

    from safe_inspect.experiments.sampling import env_runners

    threads: list[int] = []
    monkeypatch.setattr(torch, "set_num_threads", threads.append)
    seconds = iter([2.5, 6.0])
    monkeypatch.setattr(env_runners, "compiling_seconds", lambda: next(seconds))
    (tmp_path / "there").mkdir()
    config: dict[str, Any] = {"torch_num_threads": 3}
    if checkpoint is not None:
        config["continue_from"] = {"path": str(tmp_path / checkpoint), "iteration": 7, "seconds": 12.5}
    restored: list[str] = []
    algorithm: Any = SimpleNamespace(config=SimpleNamespace(env_config=config), restore_from_path=restored.append)
    run = env_runners.RunCallbacks()
    run.on_algorithm_init(algorithm=algorithm)
    assert threads == [3]
    if checkpoint == "there":
        assert (restored, algorithm._iteration, algorithm._time_total) == ([str(tmp_path / "there")], 7, 12.5)
    else:
        assert not restored
        assert not hasattr(algorithm, "_iteration")
    result: dict[str, Any] = {}
    run.on_train_result(algorithm=algorithm, result=result)
    assert result == {COMPILING: 3.5}
    env_runners.set_threads({})
    assert threads == [3, 1]


@pytest.mark.parametrize("evaluation", [False, True])
def test_the_environments_of_a_stock_runner_get_their_slots(evaluation: bool) -> None:
    from safe_inspect.experiments.sampling.env_runners import RunCallbacks

    placed: list[Any] = []
    single: Any = SimpleNamespace(place=lambda *given: placed.append(given), reports={0: {"return": 1.0, "x": 4.0}})
    env: Any = SimpleNamespace(envs=[SimpleNamespace(unwrapped=single)] * 2)
    config = SimpleNamespace(in_evaluation=evaluation, **vars(config_of(5)))
    runner: Any = SimpleNamespace(worker_index=3, config=config)
    RunCallbacks().on_environment_created(env_runner=runner, env=env, env_context={})
    assert placed == [(4, evaluation), (5, evaluation)]
    runner.worker_index = None
    RunCallbacks().on_environment_created(env_runner=runner, env=env, env_context={})
    assert placed[2:] == [(0, evaluation), (1, evaluation)]
    logger: Any = Logger()
    RunCallbacks().on_episode_end(episode=None, env_runner=runner, metrics_logger=logger, env=env, env_index=1)
    assert logger.logged == {("x",): (4.0, {"reduce": "mean", "window": 5})}
    single.reports = {}
    RunCallbacks().on_episode_end(episode=None, env_runner=runner, metrics_logger=logger, env=env)
    assert len(logger.logged) == 1
