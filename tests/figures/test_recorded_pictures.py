"""Figures, films and pages are as recorded: the place and look of each text, line and area.

To change a picture on purpose, write the record again:

    RECORD_PICTURES=1 python -m pytest -n 0 tests/figures/test_recorded_pictures.py
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.environments import load_spec
from safe_inspect.evaluation.episodes import join
from safe_inspect.evaluation.missions import mission_episode
from safe_inspect.evaluation.policies import with_scripted
from safe_inspect.evaluation.results.results import Evaluation
from safe_inspect.evaluation.rollouts import record_episode, rollout
from safe_inspect.evaluation.safety_report import safety_report
from safe_inspect.figures import curves_figure, trajectory_figure
from safe_inspect.figures.campaign_figure import campaign_figure
from safe_inspect.figures.estimate_figure import estimate_figure
from safe_inspect.figures.film import Film
from safe_inspect.figures.mission_figure import mission_figure
from safe_inspect.figures.mission_film import MissionFilm
from safe_inspect.figures.mission_page import mission_data
from safe_inspect.figures.page import episode_page
from safe_inspect.figures.trajectory_figure import safety_figure
from safe_inspect.missions.log_estimate import ONLINE_COLUMNS, LogEstimate
from safe_inspect.missions.sensor_log import TRUTH_COLUMNS
from safe_inspect.policies import DockingAutopilot, NaturalMotionInspector, RandomThrust
from safe_inspect.rendezvous.experiment import load_rendezvous
from safe_inspect.rendezvous.poses import MODEL, Edge

from .artists import entries, summary

TESTED = Path(__file__).parents[2] / "constraints.txt"
pytestmark = pytest.mark.skipif(
    f"matplotlib=={version('matplotlib')}" not in TESTED.read_text(encoding="utf-8").split(),
    reason="the pictures are recorded with the Matplotlib of constraints.txt; another one lays out differently",
)

RECORD = Path(__file__).with_name("pictures.json")


def _frames(film: Any) -> list[Any]:
    shown = []
    for number in range(3):
        film.picture(number)
        shown += entries(film._canvas.figure)
    return shown


def _data(value: Any, place: str = "") -> list[Any]:
    """Return an entry for each leaf of some data: lists of numbers as their summary and how many digits they have."""
    if isinstance(value, dict):
        return [entry for key, item in value.items() for entry in _data(item, f"{place}.{key}")]
    if isinstance(value, list):
        try:
            numbers = np.array([np.nan if item is None else item for item in value], dtype=float)
        except (TypeError, ValueError):
            return [entry for index, item in enumerate(value) for entry in _data(item, f"{place}[{index}]")]
        return [[place, [*summary(numbers.reshape(len(numbers), -1).T if numbers.size else [[]]), _digits(numbers)]]]
    return [[place, [float(value)]] if isinstance(value, int | float) else [f"{place} {value!r}", []]]


def _digits(numbers: Any) -> float:
    """Return how many digits after the point numbers are rounded to, 8 at the most."""
    finite = numbers[np.isfinite(numbers)]
    return float(next((digits for digits in range(8) if (np.round(finite, digits) == finite).all()), 8))


def _page(page: str) -> list[Any]:
    return _data(json.loads(re.search(r'id="episode">(.*?)</script>', page, re.DOTALL).group(1)))  # type: ignore[union-attr]


@pytest.fixture(scope="module")
def inspected(spec):
    return record_episode(spec, NaturalMotionInspector(), seed=1)


@pytest.fixture(scope="module")
def docked():
    return record_episode(load_spec(configs_root() / "docking" / "experiment.yml"), DockingAutopilot(), seed=3)


@pytest.fixture(scope="module")
def docked_team():
    spec = load_spec(configs_root() / "multiagent-docking" / "experiment.yml")
    return record_episode(spec, DockingAutopilot(), seed=3).until(60.0)


@pytest.fixture(scope="module")
def turned():
    """Return a short episode of deputies that turn, each with a camera."""
    spec = load_spec("safe_inspect/MultiagentWeightedSixDofInspection-v0", ["horizon=5"])
    return rollout(with_scripted(spec, RandomThrust()), {}, episodes=1, seed=0, record=1).trajectories[0]


@pytest.fixture(scope="module")
def filtered():
    glue = "agent_config.blue0_ctrl.config.config.glues.0.config"
    task = configs_root() / "translational-inspection" / "experiment-seed.yml"
    return load_experiment(task, (f"{glue}.enabled=True",)).spec


@pytest.fixture(scope="module")
def progress(tmp_path_factory):
    files = []
    for run in range(3):
        file = tmp_path_factory.mktemp("runs") / "progress.csv"
        rows = ["steps,return_mean,success_rate,inspected_fraction,delta_v,evaluation_return_mean"]
        rows += [
            f"{4000 * k},{0.1 * k + 0.03 * run},{0.05 * k},{1 / k},{k - run},{'' if k % 2 else 0.2 * k}"
            for k in range(1, 9)
        ]
        file.write_text("\n".join(rows))
        files.append(file)
    return files


@pytest.fixture(scope="module")
def estimated():
    """Return a log of 25 frames of a tumbling target, straight ahead of the camera, and an estimate of its motion."""
    target = load_rendezvous(configs_root() / "tumbling-rendezvous" / "experiment-truth.yml").config.target()
    times, still = 0.5 * np.arange(25.0), np.tile([0.0, 0.0, 0.0, 1.0], (25, 1))

    def motion(t: Any) -> Any:
        q, w = tumble(target.principal, np.array([[0.1, -0.3, 0.5, np.sqrt(0.65)]]), np.array([[0.1, 0.02, -0.07]]), t)
        return q[0], w[0]

    truth = np.zeros((25, len(TRUTH_COLUMNS)))
    for first, values in (("T_MB_x", [-3.0, 0.2, 0.1]), ("q_MB_x", still), ("q_WT_x", motion(times + 0.1)[0]),
                          ("rate_x", motion(times + 0.1)[1])):  # fmt: skip
        at = TRUTH_COLUMNS.index(first)
        truth[:, at : at + np.shape(values)[-1]] = values
    depth = 3.0 + 0.01 * np.arange(24.0 * 32.0).reshape(24, 32)
    T_BC, pose = np.eye(4), np.eye(4)  # noqa: N806
    T_BC[:3, :3], pose[:3, 3] = [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], (-3.0, 0.1, 0.2)
    log = SimpleNamespace(
        times=times, truth=truth, T_BC=T_BC,
        frame=lambda number: SimpleNamespace(time=times[number], depth=depth, valid=depth > 5.0),
        description=SimpleNamespace(
            camera=SimpleNamespace(geometry=SimpleNamespace(intrinsics=(30.0, 31.0, 15.5, 11.5)))
        ),
    )  # fmt: skip
    online = np.ones((25, len(ONLINE_COLUMNS))) / np.arange(1.0, 26.0)[:, None]
    estimate = LogEstimate(
        online=online,
        target=SimpleNamespace(predict=motion, inertia=target.principal, aligned=True, q_GT=still[0]),
        graph=SimpleNamespace(centre=np.array([0.0, 0.1, 0.05])),
        chaser_positions=np.tile([-3.0, 0.1, 0.0], (25, 1)),
        history=SimpleNamespace(times=times, chaser=still, in_inertial=(times, motion(times)[0])),
        edges=tuple(Edge(MODEL, number, pose, np.eye(6), 1.0, "model") for number in (9, 7)),
        target_model=target,
    )
    return log, estimate


SUMMARIES = [
    {
        "success": k >= 2, "cause": ("", "camera silent", "no plan")[k] if k in (1, 2) else "no fuel",
        "least_clearance": 0.1 + 0.01 * k, "mating_position_error": 0.3 if k < 2 else 0.001 * (k + 1),
        "mating_speed_error": 0.001 * k, "delta_v": 0.1 * k, "largest_gauge": 0.1 * k if k else None, "time": 200.0 + k,
    }
    for k in range(9)
]  # fmt: skip


def _missions() -> Evaluation:
    config = load_rendezvous(configs_root() / "tumbling-rendezvous" / "experiment-truth.yml").config
    return Evaluation.of("pilot", join([mission_episode(config, k, summary) for k, summary in enumerate(SUMMARIES)]))


PICTURES: dict[str, Callable[[Callable[[str], Any]], list[Any]]] = {
    "episode": lambda get: entries(trajectory_figure(get("inspected"))),
    "episode of a team": lambda get: entries(trajectory_figure(get("flown_team"))),
    "docking": lambda get: entries(trajectory_figure(get("docked"))),
    "film": lambda get: _frames(Film(get("inspected"), frames=3, width=320, turn=40.0)),
    "film of a team": lambda get: _frames(Film(get("flown_team"), frames=3, width=320)),
    "film of a docking": lambda get: _frames(Film(get("docked"), frames=3, width=320)),
    "docking of a team": lambda get: entries(trajectory_figure(get("docked_team"))),
    "episode of deputies that turn": lambda get: entries(trajectory_figure(get("turned"))),
    "film of a docking of a team": lambda get: _frames(Film(get("docked_team"), frames=3, width=320, turn=-30.0)),
    "page": lambda get: _page(episode_page(get("inspected"))),
    "page of a team": lambda get: _page(episode_page(get("flown_team"))),
    "page of a docking": lambda get: _page(episode_page(get("docked"))),
    "page of a docking of a team": lambda get: _page(episode_page(get("docked_team"))),
    "page of deputies that turn": lambda get: _page(episode_page(get("turned"))),
    "mission": lambda get: entries(mission_figure(get("record"))),
    "mission cut short": lambda get: entries(mission_figure(get("record").until(4.0))),
    "film of a mission": lambda get: _frames(MissionFilm(get("record"), frames=3, width=320, turn=40.0)),
    "page of a mission": lambda get: _data(mission_data(get("record"))),
    "campaign": lambda get: entries(campaign_figure(_missions())),
    "estimate": lambda get: entries(estimate_figure(*get("estimated"))),
    "estimate without truth": lambda get: entries(
        estimate_figure(
            SimpleNamespace(**{**vars(get("estimated")[0]), "truth": None}), replace(get("estimated")[1], edges=())
        )
    ),
    "estimate from within the target": lambda get: entries(
        estimate_figure(
            get("estimated")[0],
            replace(
                get("estimated")[1],
                edges=(replace(get("estimated")[1].edges[0], pose=np.eye(4)),),
                chaser_positions=np.zeros((25, 3)),
            ),
        )
    ),
    "curves": lambda get: entries(
        curves_figure({"one": get("progress")[:2], "other": get("progress")[2:]}, "mean", each=True)
    ),
    "safety": lambda get: entries(safety_figure(safety_report(get("filtered"), 300, 30, seed=3))),
}


@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_shows_what_is_on_record(name: str, request: pytest.FixtureRequest) -> None:
    found = json.loads(json.dumps(PICTURES[name](request.getfixturevalue)))
    if os.environ.get("RECORD_PICTURES"):
        _write(name, found)
    recorded = json.loads(RECORD.read_text(encoding="utf-8"))[name]
    assert [words for words, _ in found] == [words for words, _ in recorded]
    for (words, numbers), (_, wanted) in zip(found, recorded, strict=True):
        assert numbers == pytest.approx(wanted, rel=1e-3, abs=1e-4), words


def _write(name: str, found: list[Any]) -> None:
    record = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.is_file() else {}
    record[name] = [[words, [float(f"{number:.5g}") for number in numbers]] for words, numbers in found]
    pictures = [
        f"{json.dumps(name)}: [\n" + ",\n".join(json.dumps(entry) for entry in record[name]) + "\n]"
        for name in PICTURES if name in record
    ]  # fmt: skip
    RECORD.write_text("{\n" + ",\n".join(pictures) + "\n}\n", encoding="utf-8")
