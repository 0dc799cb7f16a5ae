"""A team of agents with the arrays of the real environment and no physics, for tests of the training."""

from __future__ import annotations

import time
from types import SimpleNamespace

import numpy as np

from safe_inspect.environments.layout import Layout
from safe_inspect.environments.transition import TeamTransition, Transition
from safe_inspect.errors import PluginValueError
from safe_inspect.random.streams import Streams

ONE = [{"agents": ["pilot"], "policies": ["pilot"], "size": 11}]
#: One agent that chooses among a few levels of each of its elements.
CHOOSING = [{"agents": ["pilot"], "policies": ["pilot"], "size": 11, "choices": (3, 2, 5)}]
#: Three agents in two groups; those of the first share one policy.
TEAM = [
    {"agents": ["red", "blue"], "policies": ["shared", "shared"], "size": 11},
    {"agents": ["green"], "policies": ["own"], "size": 7},
]
THREE = [{"agents": ["red", "blue", "green"], "policies": ["red", "blue", "green"], "size": 11}]


def layout(size, bound):
    names = tuple(f"element {index}" for index in range(size))
    return Layout(names, np.full(size, -bound), np.full(size, bound))


def chosen(choices):
    return Layout(tuple("XYZ"), np.zeros(3), np.array(choices) - 1.0, tuple(choices))


def agent_of(observation, action):
    """Return an agent with one glue for each of its layouts."""

    def glue_of(made):
        glue = SimpleNamespace(names=lambda parts: made.names, bounds=lambda parts: (made.low, made.high))
        glue.choices = lambda parts: made.choices or (0,) * made.size
        glue.leaves = lambda: [glue]
        return glue

    return SimpleNamespace(parts=None, observation_glues=[glue_of(observation)], action_glues=[glue_of(action)])


def pushes_of(group, action):
    """Return the push of each agent, from -1 to 1, shape (N, G)."""
    action = np.asarray(action, np.float64)
    if group.action_layout.choices:
        assert (action == np.rint(action)).all()
        action = 2.0 * action / group.action_layout.high - 1.0
    return np.clip(action, -1.0, 1.0).mean(axis=2)


class DummyPoints:
    """A component that offers points."""

    def __init__(self, team):
        self._points = lambda: team.state.points["chief"]

    def team_info(self, team):
        count = self._points().team_count
        return {"inspected_count": count, "inspected_fraction": count / 99}

    def info(self, group):
        return {"own_inspected_count": self._points().own_count[:, group.first : group.first + group.size].reshape(-1)}


class DummyTeam:
    """Each agent's state is a number that its mean action moves; the reward pays for being near 1, where it ends."""

    def __init__(self, experiment, num_envs, seed, first_slot):
        self.experiment, self.num_envs, self.seed = experiment, num_envs, seed
        self.slots = np.arange(first_slot, first_slot + num_envs)
        self.groups, first = [], 0
        for entry in experiment.get("team", ONE):
            group = SimpleNamespace(
                name=entry["agents"][0],
                agents=tuple(entry["agents"]),
                policies=tuple(entry["policies"]),
                first=first,
                members=slice(first, first + len(entry["agents"])),
                size=len(entry["agents"]),
                scripted=False,
                safety_filter=None,
                observation_layout=layout(entry["size"], np.inf),
                action_layout=chosen(entry["choices"]) if "choices" in entry else layout(3, 1.0),
            )
            group.agent = agent_of(group.observation_layout, group.action_layout)
            self.groups.append(group)
            first += group.size
        self.safety_filter = None
        self.groups = self.acting = tuple(self.groups)
        self.acting_indices = list(range(len(self.groups)))
        self.spec = SimpleNamespace(team_safety=None)
        self.simulation = SimpleNamespace(
            episodes=np.full(num_envs, -1),
            components={"points": DummyPoints(self)},
            state_dict=lambda: self.carried,
            load_state_dict=self.restore,
        )
        self.carried = {"scale": np.full(num_envs, -0.1)}
        shape = (num_envs, first)
        self.start, self.now = np.zeros(shape), np.zeros(shape)
        self.limit, self.t = np.zeros(num_envs, dtype=int), np.zeros(num_envs, dtype=int)
        points = SimpleNamespace(team_count=np.zeros(num_envs, dtype=int), own_count=np.zeros(shape, dtype=int))
        self.state = SimpleNamespace(
            delta_v=np.zeros(shape), finished=np.zeros(shape, dtype=np.int8), points={"chief": points}
        )
        self.steps = 0

    def restore(self, carried):
        self.carried = carried

    decides = False

    def team(self):
        return None

    def view(self, index):
        return self.groups[index]

    def observe(self, rows):
        for group in self.groups:
            observations = np.zeros((len(rows), group.size, group.observation_layout.size), np.float32)
            mine = slice(group.first, group.first + group.size)
            observations[..., 0] = self.now[rows, mine]
            observations[..., 1] = self.start[rows, mine]
            observations[..., 2] = self.slots[rows, None]
            observations[..., 3] = self.simulation.episodes[rows, None]
            observations[..., 4] = np.arange(group.first, group.first + group.size)
            observations[..., 5] = self.t[rows, None]
            yield observations

    def reset(self, rows=None, *, seed=None):
        rows = np.arange(self.num_envs) if rows is None else rows
        self.simulation.episodes[rows] += 1
        streams = Streams(self.seed, self.slots[rows], self.simulation.episodes[rows])
        self.start[rows] = streams.uniform("start", self.start.shape[1]) - 0.5
        self.now[rows] = self.start[rows]
        self.limit[rows] = 20 + (40 * streams.uniform("length")[:, 0]).astype(int)
        self.t[rows] = 0
        self.state.delta_v[rows] = self.state.finished[rows] = 0
        self.state.points["chief"].team_count[rows] = self.state.points["chief"].own_count[rows] = 0
        return tuple(self.observe(rows))

    def step(self, actions):
        self.steps += 1
        if self.steps == self.experiment.get("fail_at", -1):
            raise PluginValueError("reward `near` returned NaN; state saved in x.npz")
        time.sleep(self.experiment.get("sleep", 0.0))
        active = self.state.finished == 0
        pushes = [pushes_of(group, action) for group, action in zip(self.groups, actions, strict=True)]
        push = np.where(active, np.concatenate(pushes, axis=1), 0.0)
        self.now += np.where(active, 0.1 * push + self.experiment.get("drift", 0.0), 0.0)
        self.t += 1
        self.state.delta_v += np.abs(push)
        points = self.state.points["chief"]
        points.own_count += active
        points.team_count[:] = np.minimum(self.t, 99)
        near = np.where(active, -0.1 * np.abs(self.now - 1.0), 0.0)
        cost = np.where(active, -0.01 * np.abs(push), 0.0)
        won = active & (np.abs(self.now - 1.0) < 0.1)
        late = active & (self.t >= self.limit)[:, None] & ~won
        self.state.finished[won], self.state.finished[late] = 1, 3
        over = (self.state.finished != 0).all(axis=1)
        outcome = np.where((self.state.finished == 1).any(axis=1), 1, np.where(over, 3, 0))
        parts = []
        for group, observation in zip(self.groups, self.observe(np.arange(self.num_envs)), strict=True):
            mine = slice(group.first, group.first + group.size)
            parts.append(
                Transition(
                    observation,
                    (near + cost)[:, mine],
                    {"near": near[:, mine].copy(), "cost": cost[:, mine].copy()},
                    active[:, mine],
                    won[:, mine],
                    late[:, mine],
                    self.state.finished[:, mine].copy(),
                    None,
                )
            )
        return TeamTransition(tuple(parts), over, outcome)


def make(experiment, num_envs, seed, first_slot):
    return DummyTeam(experiment, num_envs, seed, first_slot)
