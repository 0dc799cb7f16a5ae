"""A batched environment with the infos of the real one and no physics, for tests of the training."""

from __future__ import annotations

import time

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from safe_inspect.errors import PluginValueError
from safe_inspect.randomness import Streams


class DummyVectorEnv(VectorEnv):
    """The state is a number that the mean action moves; the reward pays for being near 1."""

    metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(self, experiment, num_envs, seed, first_slot):
        self.experiment = experiment
        self.num_envs = num_envs
        self.seed = seed
        self.slots = np.arange(first_slot, first_slot + num_envs)
        self.single_observation_space = Box(-np.inf, np.inf, (11,), np.float32)
        self.single_action_space = Box(-1.0, 1.0, (3,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.episode = np.full(num_envs, -1)
        self.state, self.start = np.zeros(num_envs), np.zeros(num_envs)
        self.limit = self.t = np.zeros(num_envs, dtype=int)
        self.delta_v = np.zeros(num_envs)
        self.done = np.zeros(num_envs, dtype=bool)
        self.steps = 0

    def begin(self, rows):
        self.episode = self.episode + rows
        streams = Streams(self.seed, self.slots, self.episode)
        self.start = np.where(rows, streams.uniform("start")[:, 0] - 0.5, self.start)
        self.state = np.where(rows, self.start, self.state)
        lengths = 20 + (40 * streams.uniform("length")[:, 0]).astype(int)
        self.limit = np.where(rows, lengths, self.limit)
        self.t = np.where(rows, 0, self.t)
        self.delta_v = np.where(rows, 0.0, self.delta_v)

    def observe(self):
        observations = np.zeros((self.num_envs, 11), np.float32)
        observations[:, 0] = self.state
        observations[:, 1] = self.start
        observations[:, 2] = self.slots
        observations[:, 3] = self.episode
        return observations

    def infos(self, near, cost, status):
        inspected = np.minimum(self.t, 99)
        return {
            "delta_v": self.delta_v.copy(),
            "inspected_count": inspected.copy(),
            "inspected_fraction": inspected / 99.0,
            "status": status.astype(np.int8),
            "reward/near": near,
            "reward/cost": cost,
        }

    def reset(self, *, seed=None, options=None):
        self.begin(np.ones(self.num_envs, dtype=bool))
        self.done[:] = False
        zero = np.zeros(self.num_envs)
        return self.observe(), self.infos(zero, zero, zero)

    def step(self, actions):
        assert np.abs(actions).max() <= 1.0
        self.steps += 1
        if self.steps == self.experiment.get("fail_at", -1):
            raise PluginValueError("reward `near` returned NaN; state saved in x.npz")
        time.sleep(self.experiment.get("sleep", 0.0))
        again = self.done
        self.begin(again)
        push = np.where(again, 0.0, actions.mean(axis=1, dtype=np.float64))
        self.state = self.state + 0.1 * push + np.where(again, 0.0, self.experiment.get("drift", 0.0))
        self.t = self.t + ~again
        self.delta_v = self.delta_v + np.abs(push)
        near = np.where(again, 0.0, -0.1 * np.abs(self.state - 1.0))
        cost = np.where(again, -1.0, -0.01 * np.abs(push))  # a reset's reward counts for nothing
        won = ~again & (np.abs(self.state - 1.0) < 0.1)
        late = ~again & (self.t >= self.limit) & ~won
        self.done = won | late
        status = np.where(won, 1, np.where(late, 3, 0))
        return self.observe(), near + cost, won, late, self.infos(near, cost, status)


def make(experiment, num_envs, seed, first_slot):
    return DummyVectorEnv(experiment, num_envs, seed, first_slot)
