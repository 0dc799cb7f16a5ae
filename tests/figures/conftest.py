from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.dynamics.quaternion import to_matrix
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.environments import load_spec
from safe_inspect.evaluation.rollouts import record_episode
from safe_inspect.missions.record import MissionLog, MissionRecord, read_mission
from safe_inspect.policies import RandomThrust
from safe_inspect.rendezvous.coordination.context import Phase
from safe_inspect.rendezvous.experiment import load_rendezvous
from safe_inspect.rendezvous.planner.query import Plan, PlanStatus


@pytest.fixture(scope="session")
def spec():
    return load_spec("safe_inspect/TranslationalInspectionSeed-v0")


@pytest.fixture(scope="session")
def team():
    """Return the shipped task of three deputies."""
    return load_spec(configs_root() / "multiagent-translational-inspection" / "experiment.yml")


@pytest.fixture(scope="session")
def flown(spec):
    """Return an episode that random thrust ends soon."""
    return record_episode(spec, RandomThrust(), seed=3)


@pytest.fixture(scope="session")
def flown_team(team):
    return record_episode(team, RandomThrust(), seed=3)


STEPS, FIRST, STEP = 40, 15, 0.2


@pytest.fixture(scope="session")
def mission_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a synthetic mission: three seconds of watching, then straight to the mating point."""
    experiment = load_rendezvous(configs_root() / "tumbling-rendezvous" / "experiment-truth.yml")
    target = experiment.config.target()
    time = STEP * np.arange(STEPS)
    q, w = tumble(target.principal, np.array([[0.1, -0.3, 0.5, 0.8]]) / np.sqrt(0.99), np.full((1, 3), 0.05), time)
    end = to_matrix(q[0, -1]) @ target.mating_point
    share = np.clip((np.arange(STEPS) - FIRST) / (STEPS - 1 - FIRST), 0.0, 1.0)[:, None]
    x = (1.0 - share) * np.array([0.0, -1.5, 0.0]) + share * end
    follows = np.arange(STEPS) >= FIRST
    phases = list(Phase)
    log = MissionLog()
    for k in range(STEPS):
        log.add(
            t=time[k],
            state=phases.index(Phase.TRACK if follows[k] else Phase.OBSERVE),
            x=np.append(x[k], np.zeros(3)),
            q=np.array([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]),
            w=np.zeros(3),
            target_q=q[0, k],
            target_w=w[0, k],
            estimated_target_q=q[0, k],
            reference=np.append(x[k] + 0.01, np.zeros(3)),
            force=np.full(3, 0.01),
            torque=np.zeros(3),
            flown=np.zeros(6),
            clearance=1.0 - 0.02 * k,
            margin=0.1 if follows[k] else np.nan,
            tube=0.05 if follows[k] else np.nan,
            tube_force=0.1 if follows[k] else np.nan,
            pointing_error=0.0,
        )
    log.event(0, 0.0, "CHECKOUT", "transition", {"from": "CHECKOUT", "to": "OBSERVE"})
    in_target = np.einsum("kji,kj->ki", to_matrix(q[0]), x)[FIRST:]
    zeros = np.zeros((STEPS - FIRST, 3))
    log.plans.append(
        Plan(
            PlanStatus.SOLVED, time[FIRST], time[-1] - time[FIRST], None, time[FIRST:], x[FIRST:], zeros, zeros, zeros,
            in_target,
        )
    )  # fmt: skip
    path = tmp_path_factory.mktemp("flown") / "mission"
    path.mkdir()
    log.write(path, experiment.text, {"success": True, "cause": "", "time": STEP * STEPS})
    return path


@pytest.fixture(scope="session")
def record(mission_folder: Path) -> MissionRecord:
    return read_mission(mission_folder)
