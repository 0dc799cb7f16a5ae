"""Decisions that last, without RLlib: what is sampled of them, and their advantages, against slow references."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import TeamEnvironment
from safe_inspect.random.action_draws import Categorical, Hurdle

pytestmark = pytest.mark.ray

ONE = configs_root() / "translational-inspection" / "experiment-burn-and-coast.yml"
TEAM = configs_root() / "multiagent-translational-inspection" / "experiment-burn-and-coast.yml"
LEVELS = configs_root() / "translational-inspection" / "experiment.yml"
GAMMA = 0.98
#: A deputy leaves the scene sooner or later.
FAST = "X Thrust.config.properties={low: -3 N, high: 3 N}"
NO_FILTER = "env_config.rta.config.enabled=False"
CHOICES = ",".join(
    f"{{functor: DiscreteControllerGlue, config: {{controller: {axis} Thrust, levels: [-0.1, 0, 0.1]}}}}"
    for axis in "XYZ"
)


class Net:
    """A policy that varies with what it sees."""

    def __init__(self, rows, size, distribution, kept):
        self.observations = np.zeros((rows, size), np.float32)
        self.distribution = distribution
        generator = np.random.default_rng(0)
        self._weights = generator.normal(size=(size, 40)).astype(np.float32)
        self._kept = kept

    def __call__(self, explore):
        inputs = np.tanh(self.observations[:, :, None] * self._weights).sum(axis=1)[:, : self._kept]
        return np.ascontiguousarray(np.pad(inputs, ((0, 0), (0, self.distribution.inputs - self._kept))))


def sampler(path=ONE, *overrides, num_envs=4, first_slot=0, distribution=None, kept=None, seed=3):
    from safe_inspect.experiments.sampling.rollout import agent_slots
    from safe_inspect.experiments.sampling.sampler import DecisionSampler, Sampler

    spec = load_experiment(path, ["horizon=110", *overrides]).spec
    team = TeamEnvironment(spec, num_envs, seed=seed, first_slot=first_slot)
    distribution = distribution or Hurdle(3, 6)
    size = team.acting[0].observation_layout.size
    more = {"gamma": GAMMA} if team.decides else {}
    built = (DecisionSampler if team.decides else Sampler)(
        team,
        agent_slots(team),
        lambda policy, rows: Net(rows, size, distribution, kept or distribution.inputs),
        seed=seed,
        first_slot=first_slot,
        **more,
    )
    built.reset()
    return built


def decisions_of(rollouts):
    """Return the decisions by agent, environment, episode and control step, and each piece's values to bootstrap."""
    found = {}
    for rollout in rollouts:
        for piece in rollout.pieces:
            agent = 0
            for track in rollout.tracks:
                for member in range(len(track.rewards)):
                    span = piece.spans[agent]
                    rows = (member, piece.env, slice(span.start, span.start + span.length))
                    seen = track.observations[member, piece.env, span.start : span.start + span.length + 1]
                    found.setdefault((agent, piece.env), []).append(
                        {
                            "observations": seen.copy(),
                            "actions": track.actions[rows].copy(),
                            "rewards": track.rewards[rows].copy(),
                            "steps": track.steps[rows].copy(),
                            "log": track.log_probabilities[rows].copy(),
                            "terminated": span.terminated,
                            "truncated": span.truncated,
                            "over": piece.over,
                        }
                    )
                    agent += 1
    return found


def joined(parts):
    """Return what the groups of one environment have, agent by agent."""
    return np.concatenate([part[0] for part in parts])


def whole_episodes(pieces):
    """Join an agent's pieces to whole episodes; the last one has not ended."""
    episodes, current = [], []
    for piece in pieces:
        current.append(piece)
        if piece["over"]:
            episodes.append(current)
            current = []
    return [*episodes, current]


#: How a piece ends: terminated, truncated, over.
LOST, LATE, CUT = (True, False, True), (False, True, True), (False, False, False)


@pytest.mark.parametrize(
    ("path", "overrides", "wanted"),
    [(ONE, ["horizon=70"], {LATE, CUT}), (ONE, [FAST], {LOST, CUT}), (TEAM, [FAST, NO_FILTER], {LOST, CUT})],
    ids=["late", "lost", "team"],
)
def test_decisions_are_those_of_the_environment_flown_step_by_step(path, overrides, wanted):
    built, calls = sampler(path, *overrides, num_envs=3), (7, 190, 41, 5)
    rollouts = [built.roll(steps) for steps in calls]
    for rollout, steps in zip(rollouts, calls, strict=True):
        assert sum(piece.stop - piece.start for piece in rollout.pieces) == 3 * steps
    found = decisions_of(rollouts)
    kinds = set()
    for env in range(3):
        core = TeamEnvironment(built.environment.spec, 1, seed=3, first_slot=env)
        agents = len(built.agent_slots)
        queues = [whole_episodes(found[agent, env]) for agent in range(agents)]
        for episode in range(len(queues[0])):
            mine = [queue[episode] for queue in queues]
            rows = [[(piece, index) for piece in pieces for index in range(len(piece["rewards"]))] for pieces in mine]
            observation = joined(core.reset())
            place, totals, discounts, taken = [0] * agents, np.zeros(agents), np.ones(agents), [0] * agents
            flying, action = np.ones(agents, dtype=bool), np.zeros((agents, 4))
            while any(place[agent] < len(rows[agent]) for agent in range(agents)):
                due = joined(core.due())
                for agent in np.flatnonzero(due & flying):
                    if place[agent] < len(rows[agent]):
                        piece, index = rows[agent][place[agent]]
                        np.testing.assert_array_equal(piece["observations"][index], observation[agent])
                        action[agent] = piece["actions"][index]
                    else:  # a decision that had not elapsed when sampling ended
                        action[agent] = [0.0, 0.0, 0.0, 5.0]
                actions = np.split(action[None], np.cumsum([group.size for group in core.acting])[:-1], axis=1)
                groups = core.step(actions).groups
                observation, done = joined([group.observation for group in groups]), joined([g.done for g in groups])
                totals += discounts * joined([group.reward for group in groups])
                discounts *= GAMMA
                again = joined(core.due())
                for agent in np.flatnonzero(flying):
                    taken[agent] += 1
                    ended = done[agent]
                    if (again[agent] or ended) and place[agent] < len(rows[agent]):
                        piece, index = rows[agent][place[agent]]
                        assert piece["steps"][index] == taken[agent]
                        assert piece["rewards"][index] == np.float32(totals[agent])
                        last = index == len(piece["rewards"]) - 1
                        assert (last and (piece["terminated"] or piece["truncated"])) == ended
                        if last:
                            np.testing.assert_array_equal(piece["observations"][-1], observation[agent])
                            kinds.add((piece["terminated"], piece["truncated"], piece["over"]))
                        place[agent] += 1
                    if again[agent] or ended:
                        totals[agent], discounts[agent], taken[agent] = 0.0, 1.0, 0
                    flying[agent] &= not ended
    assert wanted <= kinds


def test_decisions_do_not_depend_on_the_batch_nor_on_the_calls():
    whole = decisions_of([sampler(num_envs=4).roll(110)])
    parts = sampler(num_envs=4)
    cut = decisions_of([parts.roll(steps) for steps in (3, 40, 67)])
    halves = {}
    for first in (0, 2):
        found = decisions_of([sampler(num_envs=2, first_slot=first).roll(110)])
        halves |= {(agent, env + first): value for (agent, env), value in found.items()}
    for key, pieces in whole.items():
        for other in (cut[key], halves[key]):
            for name in ("actions", "rewards", "steps", "log"):
                wanted = np.concatenate([piece[name] for piece in pieces])
                np.testing.assert_array_equal(np.concatenate([piece[name] for piece in other]), wanted)


def test_decisions_of_one_step_are_what_the_sampler_of_steps_keeps():
    steps = sampler(LEVELS, distribution=Categorical((3, 3, 3)), kept=9)
    same = sampler(
        LEVELS,
        f"RTAGlueCWHInspection1v1.wrapped=[{CHOICES},{{functor: CoastGlue, config: {{durations: [1]}}}}]",
        distribution=Categorical((3, 3, 3, 1)),
        kept=9,
    )
    for calls in (30, 75):
        one, other = steps.roll(calls), same.roll(calls)
        assert [piece.stop for piece in one.pieces] == [piece.stop for piece in other.pieces]
        for first, second in zip(one.pieces, other.pieces, strict=True):
            a, b = first.spans[0], second.spans[0]
            assert (a.length, a.terminated, a.truncated) == (b.length, b.terminated, b.truncated)
            mine, its = slice(a.start, a.start + a.length), slice(b.start, b.start + b.length)
            for name in ("actions", "rewards", "log_probabilities", "observations"):
                wanted = getattr(one.tracks[0], name)[0, first.env, mine]
                found = getattr(other.tracks[0], name)[0, second.env, its]
                np.testing.assert_array_equal(found[..., :3] if name == "actions" else found, wanted)
            assert (other.tracks[0].steps[0, second.env, its] == 1).all()
    assert [{**report, "seconds": 0} for report in steps.reports] == [
        {key: value for key, value in {**report, "seconds": 0}.items() if key != "decisions"} for report in same.reports
    ]


def test_whole_episodes_are_flown_as_often_as_asked():
    built = sampler(num_envs=3)
    rollout = built.roll_episodes(5)
    assert len(rollout.pieces) == 5
    assert [piece.env for piece in rollout.pieces].count(0) == 2
    assert all(piece.over and piece.spans[0].length > 0 for piece in rollout.pieces)
    assert {report["decisions"] for report in built.reports} == {
        float(piece.spans[0].length) for piece in rollout.pieces
    }


def test_semi_markov_advantages_at_every_kind_of_end():
    """A_t = sum_n (prod lambda g) delta, with g = gamma^k of each decision, worked out from single control steps."""
    from safe_inspect.experiments.learning.ppo_kernels import Batch

    rng = np.random.default_rng(5)
    lengths, terminated = np.array([4, 1, 3, 5]), np.array([True, False, False, True])
    steps = rng.integers(1, 9, lengths.sum())
    single = [rng.normal(size=count) for count in steps]
    rewards = np.array([(GAMMA ** np.arange(len(part)) * part).sum() for part in single])
    values = rng.normal(size=lengths.sum() + len(lengths))
    advantages, first, row = [], 0, 0
    for length, ended in zip(lengths, terminated, strict=True):
        piece = values[first : first + length + 1].copy()
        piece[-1] = 0.0 if ended else piece[-1]
        for t in range(length):
            total, weight = 0.0, 1.0
            for n in range(t, length):
                discount, delta = 1.0, -piece[n]
                for reward in single[row + n]:
                    delta += discount * reward
                    discount *= GAMMA
                total += weight * (delta + discount * piece[n + 1])
                weight *= 0.9 * discount
            advantages.append(total)
        first, row = first + length + 1, row + length
    batch = Batch(
        np.zeros((len(values), 1), np.float32), lengths, terminated, np.zeros((row, 1), np.float32),
        np.zeros((row, 2), np.float32), np.zeros(row, np.float32), rewards, steps=steps,
    )  # fmt: skip
    batch.advise(values, GAMMA, 0.9)
    wanted = np.array(advantages)
    np.testing.assert_allclose(batch.targets - np.delete(values, np.cumsum(lengths + 1) - 1), wanted, atol=1e-12)
    np.testing.assert_allclose(batch.advantages, (wanted - wanted.mean()) / wanted.std(), atol=1e-12)
