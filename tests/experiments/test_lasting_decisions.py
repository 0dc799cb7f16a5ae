"""Decisions that last in an environment without physics, against lists that are written down step by step."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from dummy_environment import ONE, TEAM, DummyTeam

from safe_inspect.experiments.modules.tanh_net import LEAST_ROWS
from safe_inspect.experiments.sampling.rollout import agent_slots
from safe_inspect.experiments.sampling.sampler import DecisionSampler
from safe_inspect.random.action_draws import DrawRows, Hurdle

pytestmark = pytest.mark.ray

GAMMA, DURATIONS, ENVS, FIRST, SEED = 0.9, (1, 2, 5, 9), 20, 6, 3


class Deciding(DummyTeam):
    """Agents whose last element of the action says for how many steps the others hold.

    Attributes:
        log: Of each step the agents that decide, their actions, rewards, ends and observations before and after, and
            the episodes that end, by agent: each of shape (N,) or (N, ...).
    """

    decides = True

    def __init__(self, team: Any, num_envs: int, first_slot: int) -> None:
        super().__init__({"team": team, "drift": 0.02}, num_envs, SEED, first_slot)
        for group in self.groups:
            layout = group.action_layout
            group.action_layout = SimpleNamespace(size=4, choices=(), draw=self._drawn)
            assert layout.size == 3
        self.left = np.zeros(self.start.shape, dtype=np.int64)
        self.held = np.zeros((*self.start.shape, 3))
        self.log: list[dict[str, Any]] = []

    @staticmethod
    def _drawn(generator: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        return np.concatenate(
            (generator.uniform(-1.0, 1.0, (*shape, 3)), generator.integers(0, 4, (*shape, 1))), axis=-1
        )

    def split(self, array: np.ndarray) -> list[np.ndarray]:
        return [array[:, group.first : group.first + group.size] for group in self.groups]

    def due(self) -> tuple[np.ndarray, ...]:
        return tuple(self.split(self.left == 0))

    def reset(self, rows: Any = None, *, seed: Any = None) -> Any:
        found = super().reset(rows, seed=seed)
        self.left[np.arange(self.num_envs) if rows is None else rows] = 0
        return found

    def step(self, actions: Any) -> Any:
        whole, due, flying = np.concatenate(actions, axis=1), self.left == 0, self.state.finished == 0
        before = [observation.copy() for observation in self.observe(np.arange(self.num_envs))]
        self.held[due] = whole[due][:, :3]
        self.left[due] = np.array(DURATIONS)[whole[due][:, 3].astype(int)]
        found = super().step([part.copy() for part in self.split(self.held)])
        self.left -= 1
        for index, group in enumerate(found.groups):
            for member in range(self.groups[index].size):
                agent = self.groups[index].first + member
                self.log.append({
                    "agent": agent, "due": (due & flying)[:, agent], "action": whole[:, agent].copy(),
                    "reward": group.reward[:, member], "terminated": group.terminated[:, member],
                    "truncated": group.truncated[:, member], "before": before[index][:, member],
                    "after": group.observation[:, member].copy(), "over": found.over,
                })  # fmt: skip
        return found


class Net:
    """A policy that varies with what it sees; it is made for as many rows as it is asked for."""

    distribution = Hurdle(3, 4)

    def __init__(self, rows: int, size: int) -> None:
        self.observations, self.asked = np.zeros((rows, size), np.float32), list[bool]()
        self._weights = np.random.default_rng(0).normal(size=(size, self.distribution.inputs)).astype(np.float32)

    def __call__(self, explore: bool) -> np.ndarray:
        self.asked.append(explore)
        return self.of(self.observations)

    def of(self, observations: np.ndarray) -> np.ndarray:
        """Return the inputs of the action distribution for observations, shape (R, O)."""
        return np.asarray(np.sin(observations[:, :, None] * self._weights).sum(axis=1))


def sampler_of(team: Any, num_envs: int = ENVS, first_slot: int = FIRST) -> tuple[DecisionSampler, Deciding, list[Net]]:
    environment, made = Deciding(team, num_envs, first_slot), list[Net]()
    sizes = {policy: entry["size"] for entry in team for policy in entry["policies"]}

    def nets(policy: str, rows: int) -> Any:
        made.append(Net(rows, sizes[policy]))
        return made[-1]

    found = DecisionSampler(
        environment, agent_slots(environment), nets, gamma=GAMMA, seed=SEED, first_slot=first_slot  # type: ignore[arg-type]
    )  # fmt: skip
    found.reset()
    return found, environment, made


def written(log: list[dict[str, Any]], agents: int, envs: int) -> dict[Any, list[dict[str, Any]]]:
    """Return the decisions of each agent in each environment, step by step; the last may not have elapsed."""
    found: dict[Any, list[dict[str, Any]]] = {(agent, env): [] for agent in range(agents) for env in range(envs)}
    flying = dict.fromkeys(found, True)
    for entry in log:
        for env in range(envs):
            key = entry["agent"], env
            if flying[key]:
                if entry["due"][env]:
                    found[key].append({
                        "seen": entry["before"][env], "action": entry["action"][env], "reward": 0.0, "steps": 0,
                        "end": None,
                    })  # fmt: skip
                now = found[key][-1]
                now["reward"] += GAMMA ** now["steps"] * entry["reward"][env]
                now["steps"] += 1
                now["after"] = entry["after"][env]
                if entry["terminated"][env] or entry["truncated"][env]:
                    now["end"] = (bool(entry["terminated"][env]), bool(entry["truncated"][env]))
                    flying[key] = False
            if entry["over"][env]:
                flying[key] = True
    return found


def sampled(rollouts: list[Any], agents: list[tuple[int, int]], envs: int) -> dict[Any, list[dict[str, Any]]]:
    """Return the decisions of each agent in each environment, piece by piece."""
    found: dict[Any, list[dict[str, Any]]] = {(agent, env): [] for agent in range(len(agents)) for env in range(envs)}
    for rollout in rollouts:
        for piece in rollout.pieces:
            for agent, (group, member) in enumerate(agents):
                span, track = piece.spans[agent], rollout.tracks[group]
                for place in range(span.start, span.start + span.length):
                    at, last = (member, piece.env, place), place == span.start + span.length - 1
                    ended = last and (span.terminated or span.truncated)
                    found[agent, piece.env].append({
                        "seen": track.observations[at].copy(), "action": track.actions[at].copy(),
                        "reward": float(track.rewards[at]), "steps": int(track.steps[at]),
                        "end": (span.terminated, span.truncated) if ended else None,
                        "after": track.observations[member, piece.env, place + 1].copy(),
                    })  # fmt: skip
    return found


@pytest.mark.parametrize("team", [ONE, TEAM], ids=["one", "team"])
def test_each_decision_is_kept_once_with_its_steps_and_discounted_reward(team: Any) -> None:
    sampler, environment, made = sampler_of(team)
    agents = [(slot.group, slot.member) for slot in sampler.agent_slots]
    calls = (7, 1, 60, 33, 3)
    rollouts = [sampler.roll(steps) for steps in calls]
    for rollout, steps in zip(rollouts, calls, strict=True):
        assert sum(piece.stop - piece.start for piece in rollout.pieces) == ENVS * steps
    expected = written(environment.log, len(agents), ENVS)
    found = sampled(rollouts, agents, ENVS)
    ends = set()
    for key, decisions in expected.items():
        mine = found[key]
        elapsed = len(decisions) - (environment.left[key[1], key[0]] > 0 and decisions[-1]["end"] is None)
        assert len(mine) == elapsed > 5
        for one, other in zip(mine, decisions, strict=False):
            np.testing.assert_array_equal(one["seen"], other["seen"])
            np.testing.assert_array_equal(one["action"], other["action"].astype(np.float32))
            np.testing.assert_array_equal(one["after"], other["after"])
            assert one["reward"] == pytest.approx(other["reward"], rel=1e-6)
            assert (one["steps"], one["end"]) == (other["steps"], other["end"])
            ends.add(one["end"])
    assert {(True, False), (False, True)} <= ends
    assert {one["steps"] for decisions in found.values() for one in decisions} >= {1, 2, 5, 9}
    assert not environment.observes_coasting  # type: ignore[attr-defined]
    # The mean over the agents of what they decided is reported with each episode.
    reports = sum(piece.over for rollout in rollouts for piece in rollout.pieces)
    assert len(sampler.reports) == reports > ENVS
    ended = sum(one["decisions"] * len(agents) for one in sampler.reports)
    assert ended == pytest.approx(_of_ended_episodes(environment.log, len(agents)))
    sizes = {LEAST_ROWS, 2 * LEAST_ROWS, 4 * LEAST_ROWS, ENVS, 2 * ENVS}
    assert {len(net.observations) for net in made} <= sizes


def test_a_policy_is_asked_for_each_decision_with_what_its_agent_sees() -> None:
    sampler, _, made = sampler_of(TEAM)
    rollout = sampler.roll(40)
    nets = {slot.policy: Net(1, size) for slot, size in zip(sampler.agent_slots, (11, 11, 7), strict=True)}
    for piece in rollout.pieces:
        for slot, span in zip(sampler.agent_slots, piece.spans, strict=True):
            track, rows = rollout.tracks[slot.group], slice(span.start, span.start + span.length)
            inputs = nets[slot.policy].of(track.observations[slot.member, piece.env, rows])
            np.testing.assert_allclose(track.inputs[slot.member, piece.env, rows], inputs, atol=1e-4)
    asked = [one for net in made for one in net.asked]
    assert set(asked) == {True}
    assert len(asked) <= 2 * 40  # once a step for each policy
    for net in made:
        net.asked.clear()
    rollout = sampler.roll_episodes(3)
    asked = [one for net in made for one in net.asked]
    assert set(asked) == {True}
    assert max(piece.stop - piece.start for piece in rollout.pieces) <= 60
    sampler.roll_episodes(2, explore=False)
    assert {explore for net in made for explore in net.asked[-1:]} == {False}


def _of_ended_episodes(log: list[dict[str, Any]], agents: int) -> int:
    """Return how many decisions were begun in episodes that have ended."""
    running, total = np.zeros(ENVS, dtype=np.int64), 0
    for entry in log:
        running += entry["due"]
        if entry["agent"] == agents - 1:
            total += int(running[entry["over"]].sum())
            running[entry["over"]] = 0
    return total


def test_draws_depend_on_slot_episode_and_step_alone() -> None:
    whole, environment, _ = sampler_of(TEAM)
    rollout = whole.roll(80)
    part, _, _ = sampler_of(TEAM, 5, FIRST + 9)
    again = [part.roll(steps) for steps in (33, 47)]
    agents = [(slot.group, slot.member) for slot in whole.agent_slots]
    mine, theirs = sampled([rollout], agents, ENVS), sampled(again, agents, 5)
    for (agent, env), decisions in theirs.items():
        for one, other in zip(decisions, mine[agent, env + 9], strict=True):
            np.testing.assert_array_equal(one["action"], other["action"])
            assert one["reward"] == other["reward"]
    # The first decision of an agent is that of its slot's stream.
    for agent, (group, member) in enumerate(agents):
        track, slots = rollout.tracks[group], np.arange(FIRST, FIRST + ENVS, dtype=np.uint64)
        inputs, zeros = np.ascontiguousarray(track.inputs[member, :, 0]), np.zeros(ENVS, dtype=np.int64)
        action, log = np.empty((ENVS, 4), np.float32), np.empty(ENVS, np.float32)
        Net.distribution.draw(inputs, True, DrawRows(np.uint64(SEED), slots, zeros, zeros, zeros + agent), action, log)
        np.testing.assert_array_equal(track.actions[member, :, 0], action)
        np.testing.assert_array_equal(track.log_probabilities[member, :, 0], log)
    assert environment.num_envs == ENVS


def test_whole_episodes_of_decisions_are_flown_from_their_beginning() -> None:
    sampler, _, _ = sampler_of(TEAM, 4)
    sampler.roll(9)
    for _ in range(2):
        sampler.reports.clear()
        rollout = sampler.roll_episodes(6, explore=False)
        assert sorted(piece.env for piece in rollout.pieces) == [0, 0, 1, 1, 2, 3]
        assert all(piece.over and piece.begun == 0 for piece in rollout.pieces)
        assert len(sampler.reports) == 6
        spans = [span for piece in rollout.pieces for span in piece.spans]
        assert all(span.length > 0 and (span.terminated or span.truncated) for span in spans)
        counts = sorted(sum(span.length for span in piece.spans) / 3.0 for piece in rollout.pieces)
        assert sorted(report["decisions"] for report in sampler.reports) == pytest.approx(counts)
