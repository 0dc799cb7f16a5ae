"""The sampler without RLlib: what is saved of episodes that end, continue or are left early."""

from __future__ import annotations

import numpy as np
import pytest
from dummy_environment import ONE, TEAM, THREE, DummyTeam

from safe_inspect.random.action_draws import Gaussian

pytestmark = pytest.mark.ray

NOISE = 0.4


class Net:
    """A policy that steers towards 1, slowly."""

    def __init__(self, rows, size):
        self.observations = np.zeros((rows, size), np.float32)
        self.distribution = Gaussian(3)

    def __call__(self, explore):
        mean = np.repeat(0.3 * (1.0 - self.observations[:, :1]), 3, axis=1)
        return np.concatenate((mean, np.full_like(mean, np.log(NOISE))), axis=1).astype(np.float32)


def sampler(team=TEAM, num_envs=5, first_slot=0, seed=3, **experiment):
    from safe_inspect.experiments.sampling.rollout import agent_slots
    from safe_inspect.experiments.sampling.sampler import Sampler

    environment = DummyTeam({"team": team, **experiment}, num_envs, seed, first_slot)
    sizes = {policy: entry["size"] for entry in team for policy in entry["policies"]}
    built = Sampler(
        environment,
        agent_slots(environment),
        lambda policy, rows: Net(rows, sizes[policy]),
        seed=seed,
        first_slot=first_slot,
    )
    built.reset()
    return built


def pieces_of(built, rollout, agent_slot):
    """Yield the arrays of one agent in each piece in which it flies: observations, actions, rewards, span, piece."""
    index = built.agent_slots.index(agent_slot)
    track = rollout.tracks[agent_slot.group]
    for piece in rollout.pieces:
        span = piece.spans[index]
        if not span.length:
            continue
        stop = piece.start + span.length
        observations = track.observations[agent_slot.member, piece.env, piece.start : stop + 1].copy()
        if piece.over and stop == piece.stop:
            observations[-1] = piece.finals[agent_slot.group][agent_slot.member]
        part = (agent_slot.member, piece.env, slice(piece.start, stop))
        yield observations, track.actions[part], track.rewards[part], span, piece


@pytest.mark.parametrize("team", [ONE, THREE, TEAM])
def test_every_piece_is_an_unbroken_stretch_of_one_episode(team):
    built = sampler(team)
    known = {}
    ends = set()
    for steps in (7, 40, 1, 33, 60):
        rollout = built.roll(steps)
        for agent_slot in built.agent_slots:
            for observations, actions, rewards, span, piece in pieces_of(built, rollout, agent_slot):
                slot, episode = observations[0, 2], observations[0, 3]
                assert (observations[:, 2] == slot).all()
                assert (observations[:, 3] == episode).all()
                if agent_slot.group == 0 or len(team) == 1:
                    np.testing.assert_array_equal(observations[:, 4], agent_slot.deputy)
                np.testing.assert_array_equal(observations[:, 5], piece.begun + np.arange(span.length + 1))
                push = np.clip(actions, -1.0, 1.0).astype(np.float64).mean(axis=1)
                np.testing.assert_allclose(np.diff(observations[:, 0]), 0.1 * push, atol=1e-6)
                expected = -0.1 * np.abs(observations[1:, 0] - 1.0) - 0.01 * np.abs(push)
                np.testing.assert_allclose(rewards, expected, atol=1e-6)
                near = np.abs(observations[:, 0] - 1.0) < 0.1
                assert not near[1:-1].any()  # it would have ended
                assert span.terminated == near[-1]
                ends.add((span.terminated, span.truncated, piece.over))
                key = (agent_slot.agent, slot, episode)
                assert known.get(key, (0, False)) == (piece.begun, False)  # continues where it was cut
                known[key] = (piece.begun + span.length, span.terminated or span.truncated)
    assert {(True, False, True), (False, True, True), (False, False, False)} <= ends
    if len(built.agent_slots) > 1:
        assert (True, False, False) in ends  # one that ended early, while the others went on


def test_nothing_is_thrown_away():
    built = sampler(THREE, num_envs=4)
    for steps in (13, 50, 29):
        rollout = built.roll(steps)
        taken = np.zeros((4, steps), dtype=int)
        for piece in rollout.pieces:
            taken[piece.env, piece.start : piece.stop] += 1
        assert (taken == 1).all()


@pytest.mark.parametrize("team", [ONE, TEAM])
def test_the_batch_and_the_length_of_a_sample_do_not_matter(team):
    whole, parts = sampler(team, 6), [sampler(team, 2), sampler(team, 4, first_slot=2)]
    rollout = whole.roll(90)
    pairs = [(part.roll(40), part.roll(50)) for part in parts]
    for group, track in enumerate(rollout.tracks):
        for name in ("observations", "actions", "inputs", "log_probabilities", "rewards"):
            rows = []
            for first, second in pairs:
                early, late = getattr(first.tracks[group], name), getattr(second.tracks[group], name)
                rows.append(np.concatenate((early[:, :, :40], late[:, :, :50]), axis=2))
            np.testing.assert_array_equal(np.concatenate(rows, axis=1), getattr(track, name)[:, :, :90])


def test_whole_episodes_do_not_favour_short_ones():
    built = sampler(ONE, num_envs=8, drift=0.0)
    lengths = {}
    rollout = built.roll_episodes(19)
    for observations, *_, piece in pieces_of(built, rollout, built.agent_slots[0]):
        assert piece.over
        assert piece.begun == 0
        lengths.setdefault(int(observations[0, 2]), []).append(len(observations) - 1)
    assert len(rollout.pieces) == len(built.reports) == 19
    assert [len(lengths[slot]) for slot in range(8)] == [3, 3, 3, 2, 2, 2, 2, 2]
    again = sampler(ONE, num_envs=8)
    first = again.roll_episodes(8)
    assert sorted(piece.stop for piece in first.pieces) == sorted(found[0] for found in lengths.values())


def test_the_mean_is_flown_without_exploration():
    built = sampler(ONE)
    rollout = built.roll(10, explore=False)
    track = rollout.tracks[0]
    np.testing.assert_array_equal(track.actions, track.inputs[..., :3])


def test_an_episode_is_reported_with_its_sums():
    built = sampler(TEAM, num_envs=6)
    returns = {}
    for steps in (30, 30, 30):
        rollout = built.roll(steps)
        for agent_slot in built.agent_slots:
            for observations, _, rewards, _, _ in pieces_of(built, rollout, agent_slot):
                key = (observations[0, 2], observations[0, 3])
                found = returns.setdefault(key, {}).setdefault(agent_slot.agent, 0.0)
                returns[key][agent_slot.agent] = found + rewards.astype(np.float64).sum()
    assert len(built.reports) > 5
    for report in built.reports:
        parts = {agent: report[f"agents/{agent}/return"] for agent in ("red", "blue", "green")}
        assert report["return"] == pytest.approx(sum(parts.values()))
        assert report["return"] == pytest.approx(report["reward/near"] + report["reward/cost"])
        assert any(found == pytest.approx(parts, abs=1e-4) for found in returns.values())
        assert report["success_rate"] == max(report[f"agents/{agent}/success"] for agent in parts)
        assert report["length"] == max(report[f"agents/{agent}/length"] for agent in parts)
        assert report["delta_v"] == pytest.approx(np.mean([report[f"agents/{agent}/delta_v"] for agent in parts]))


def test_actions_are_gaussian_and_their_densities_rllibs():
    import torch
    from ray.rllib.core.distribution.torch.torch_distribution import TorchDiagGaussian

    from safe_inspect.random.action_draws import DrawRows, draw_gaussian

    rows = 4000
    inputs = np.random.default_rng(0).normal(0.0, 0.5, (rows, 6)).astype(np.float32)
    actions, densities = np.zeros((rows, 3), np.float32), np.zeros(rows, np.float32)
    slots, zeros = np.arange(rows, dtype=np.uint64), np.zeros(rows, np.int64)
    draw_gaussian(inputs, True, DrawRows(np.uint64(5), slots, zeros, zeros, zeros), actions, densities)
    expected = TorchDiagGaussian.from_logits(torch.from_numpy(inputs)).logp(torch.from_numpy(actions))
    np.testing.assert_allclose(densities, expected.numpy(), atol=5e-6)
    z = (actions - inputs[:, :3]) / np.exp(inputs[:, 3:])
    assert np.abs(z.mean(axis=0)).max() < 4.0 / np.sqrt(rows)
    assert np.abs(z.var(axis=0) - 1.0).max() < 4.0 * np.sqrt(2.0 / rows)
    assert np.abs(np.corrcoef(z.T) - np.eye(3)).max() < 4.0 / np.sqrt(rows)
    others = [np.zeros((rows, 3), np.float32) for _ in range(3)]
    elsewhere = ((np.uint64(6), zeros, zeros), (np.uint64(5), zeros + 1, zeros), (np.uint64(5), zeros, zeros + 1))
    for other, (seed, episode, step) in zip(others, elsewhere, strict=True):
        draw_gaussian(inputs, True, DrawRows(seed, slots, episode, step, zeros), other, densities)
    for other in others:  # another seed, another episode, another step
        assert np.abs(np.corrcoef(z[:, 0], other[:, 0] - inputs[:, 0])[0, 1]) < 4.0 / np.sqrt(rows)
