"""The figures of a team and of each of its agents, from the thrusts of three deputies flown again in plain NumPy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from safe_inspect.config.data import configs_root

from .figures import blocks, phi
from .flown import starting, typed
from .one_deputy import DT, MASS, RADIUS, TERMS, fibonacci, hold, lit, seen, sun_direction
from .test_evaluation import check_end, check_table

EPISODES, HORIZON, POINTS, PRICE = 6, 60, 2, -0.001
AGENTS = ("blue0_ctrl", "blue1_ctrl", "blue2_ctrl")
THRUST = "agent_config.blue#_ctrl.config.config.parts.{}.config.properties={{low: -0.4 N, high: 0.4 N}}"
WORDS = (
    f"horizon={HORIZON}",
    f"env_config.simulator.config.inspection_points_map.chief.num_points={POINTS}",
    *(THRUST.format(axis) for axis in range(3)),
)


class Episode:
    """One episode of three deputies: what each of them does until its own end, and all of them until the last one.

    Args:
        start: Positions and velocities at the reset, shape (3, 6).
        sun: The sun's angle at the reset.
        thrust: What each deputy commands, shape (T, 3, 3).
    """

    def __init__(self, start: np.ndarray, sun: float, thrust: np.ndarray) -> None:
        self.points, motion = RADIUS * fibonacci(POINTS), hold(DT)
        self.states, self.sun, self.spent = [start], [sun], [np.zeros(3)]
        self.owner = np.full(POINTS, -1)
        self.status, self.length = ["running"] * 3, [0] * 3
        self.terms = [dict.fromkeys(TERMS, 0.0) for _ in AGENTS]
        self.last_new = [0.0] * 3
        self._look()
        self.counts = [self._count()]
        for step, given in enumerate(thrust):
            flying = np.array([status == "running" for status in self.status])
            assert flying.any()
            assert not given[~flying].any(), "a deputy that has ended coasts"
            self.states.append(np.concatenate((self.states[-1], given), axis=1) @ motion.T)
            self.sun.append(self.sun[-1] + 0.001027 * DT)
            self.spent.append(self.spent[-1] + np.abs(given).sum(axis=1) * DT / MASS)
            self._look()
            self.counts.append(self._count())
            new = self.counts[-1] - (self.counts[-2] if step else 0)
            for k in np.flatnonzero(flying):
                self._pay(k, new)
                self.length[k] = step + 1
            self._end(flying)
        assert "running" not in self.status

    def _count(self) -> int:
        return int((self.owner >= 0).sum())

    def _look(self) -> None:
        bright = lit(self.points, sun_direction(self.sun[-1]), 0.0)
        for k in range(3):
            self.owner[seen(self.points, self.states[-1][k, :3]) & bright & (self.owner < 0)] = k

    def _pay(self, k: int, new: int) -> None:
        near = math.hypot(*self.states[-1][k, :3]) < 10.0
        price = PRICE * (self.spent[-1][k] - self.spent[-2][k])
        for name, value in zip(TERMS, (0.01 * new, float(self.counts[-1] == POINTS), -1.0 * near, price), strict=True):
            self.terms[k][name] += value
        if new:
            self.last_new[k] = self.spent[-1][k]

    def _end(self, flying: np.ndarray) -> None:
        where = self.states[-1][:, :3]
        collided = min(self.apart(-1)) < 10.0
        for k in np.flatnonzero(flying):
            distance = math.hypot(*where[k])
            if collided or distance < 10.0 or distance > 800.0:
                self.status[k] = "lose"
            elif self.counts[-1] == POINTS:
                self.status[k] = "win"
            elif len(self.states) - 1 == HORIZON:
                self.status[k] = "draw"

    def apart(self, state: int) -> list[float]:
        """Return the distances of the three pairs."""
        a, b, c = self.states[state][:, :3]
        return [math.dist(a, b), math.dist(b, c), math.dist(a, c)]

    def of_agent(self, k: int) -> dict[str, float]:
        """Return the figures of an agent until its own end."""
        states, last = np.array(self.states)[: self.length[k] + 1], self.length[k]
        own, others = states[:, k], [j for j in range(3) if j != k]
        terms = {f"reward/{name}": value for name, value in self.terms[k].items()}
        distance = np.linalg.norm(own[:, :3], axis=1)
        pairs = [np.linalg.norm(own[:, :3] - states[:, j, :3], axis=1) for j in others]
        return {
            "return": sum(terms.values()),
            "inspected first": float((self.owner == k).sum()),
            "delta-v": self.spent[last][k],
            "length": float(last),
            **terms,
            "interventions": 0.0,
            "smallest range": distance.min(),
            "largest range": distance.max(),
            "largest speed": np.linalg.norm(own[:, 3:], axis=1).max(),
            "delta-v after last point": self.spent[last][k] - self.last_new[k],
            **{
                f"phi {name}": values.min()
                for name, values in phi(own[:, :3], own[:, 3:], self.sun[: last + 1]).items()
            },
            "phi deputy_collision": np.min(pairs) - 10.0,
        }

    def of_team(self) -> dict[str, float]:
        """Return the figures of the whole episode."""
        agents = [self.of_agent(k) for k in range(3)]
        found = {name: [agent[name] for agent in agents] for name in agents[0]}
        reached = np.flatnonzero(np.array(self.counts) >= 0.9 * POINTS)
        sums = ("return", "interventions", *(name for name in found if name.startswith("reward/")))
        return {
            **{name: sum(found[name]) for name in sums},
            **{name: min(values) for name, values in found.items() if name.startswith(("phi ", "smallest"))},
            **{name: max(found[name]) for name in ("largest range", "largest speed", "length")},
            "delta-v per deputy": float(np.mean(found["delta-v"])),
            "delta-v after last point": float(np.mean(found["delta-v after last point"])),
            "inspected points": float(self.counts[-1]),
            "inspected fraction": self.counts[-1] / POINTS,
            "closest deputies": min(min(self.apart(state)) for state in range(len(self.states))),
            "time to 90 %": DT * reached[0] if len(reached) else math.nan,
        }

    @property
    def outcome(self) -> str:
        """How it ended for the team."""
        return next(status for status in ("lose", "win", "draw") if status in self.status)


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Return what an evaluation printed, its table of episodes, and the episodes flown again."""
    experiment = configs_root() / "multiagent-translational-inspection" / "experiment-seed.yml"
    folder = tmp_path_factory.mktemp("team") / "out"
    given = ("--cfg", experiment, *WORDS, "--episodes", EPISODES, "--record", EPISODES, "--seed", "7")
    printed = typed("evaluate", "random", *given, "--output", folder)
    table, recorded = (dict(np.load(folder / f"{name}.npz")) for name in ("episodes", "trajectories"))
    episodes = []
    for index in range(EPISODES):
        states = starting(f"{index}/", recorded)
        start = np.concatenate((states["position"], states["velocity"]), axis=-1)
        episode = Episode(start[0], states["arrays/sun_angle"][0], states["control"])
        np.testing.assert_allclose(np.array(episode.states), start, rtol=0, atol=1e-7)
        np.testing.assert_allclose(np.array(episode.spent), states["delta_v"], rtol=1e-12)
        episodes.append(episode)
    return printed, table, episodes


def test_the_arrays_of_the_episodes(flown):
    _, table, episodes = flown
    table = {name: values for name, values in table.items() if not name.startswith(("initial_states/", "tree"))}
    np.testing.assert_array_equal(table.pop("team/status"), [one.outcome for one in episodes])
    figures = {"team": [one.of_team() for one in episodes]}
    for k, agent in enumerate(AGENTS):
        np.testing.assert_array_equal(table.pop(f"agents/{agent}/status"), [one.status[k] for one in episodes])
        figures[f"agents/{agent}"] = [one.of_agent(k) for one in episodes]
    for start, found in figures.items():
        for name in found[0]:
            path, expected = f"{start}/figures/{name}", [row[name] for row in found]
            np.testing.assert_allclose(table.pop(path), expected, rtol=1e-9, atol=1e-6, err_msg=path)
    assert not table, "every array is computed a second time"


def test_the_printed_blocks(flown):
    printed, _, episodes = flown
    assert {one.outcome for one in episodes} == {"win", "lose", "draw"}
    assert any(len(set(one.length)) > 1 for one in episodes)
    of_team, *of_agents = blocks(printed)
    units = {
        "inspected points": "points", "inspected first": "points", "delta-v per deputy": "m/s", "delta-v": "m/s",
        "length": "steps", "closest deputies": "m", "interventions": "steps", "smallest range": "m",
        "largest range": "m", "largest speed": "m/s", "delta-v after last point": "m/s", "time to 90 %": "s",
        "phi sun": "rad", **{f"phi {name}": "m" for name in ("chief_collision", "r_max", "PSM", "deputy_collision")},
        **{f"phi {name}": "m/s" for name in ("rel_vel", "x_vel", "y_vel", "z_vel")},
    }  # fmt: skip
    rows = [one.of_team() for one in episodes]
    check_table(of_team, {name: [np.array([row[name] for row in rows])] for name in rows[0]}, units)
    ends = [line for line in printed.splitlines() if "success" in line and not line.startswith("  ")]
    check_end(ends[0], np.array([one.outcome for one in episodes]))
    for k, (agent, table) in enumerate(zip(AGENTS, of_agents, strict=True)):
        rows = [one.of_agent(k) for one in episodes]
        check_table([of_team[0], *table], {name: [np.array([row[name] for row in rows])] for name in rows[0]}, units)
        assert ends[1 + k].startswith(f"{agent}: success")
        check_end(ends[1 + k], np.array([one.status[k] for one in episodes]))
