from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.dones import DoneStatus
from safe_inspect.environments import BatchedEnvironment, TeamEnvironment, load_spec
from safe_inspect.errors import ArgumentError
from safe_inspect.evaluation import Flight, rollout
from safe_inspect.evaluation.results.files import save_packed
from safe_inspect.evaluation.task import default_metrics
from safe_inspect.policies import NaturalMotionInspector, RandomThrust, ZeroThrust

FIGURES = ("returns", "length", "status", "inspected_fraction", "delta_v")


def assert_equal(one, other, folder):
    """Check that two rollouts have bit-identical episodes."""
    for name, episodes in (("one", one), ("other", other)):
        save_packed(folder / f"{name}.npz", episodes)
    with np.load(folder / "one.npz") as mine, np.load(folder / "other.npz") as theirs:
        assert list(mine) == list(theirs)
        for name, values in mine.items():
            np.testing.assert_array_equal(values, theirs[name], err_msg=name)


def test_the_episodes_do_not_depend_on_the_size_of_the_batch(spec):
    whole = rollout(spec, RandomThrust(), episodes=11, seed=7, num_envs=11, record=11)
    parts = rollout(spec, RandomThrust(), episodes=11, seed=7, num_envs=4, record=11)
    assert len(set(whole.length)) > 1  # so that rows end at different times
    for name in FIGURES:
        np.testing.assert_array_equal(getattr(whole, name), getattr(parts, name))
    for name, values in whole.terms.items():
        np.testing.assert_array_equal(values, parts.terms[name])
    for one, other in zip(whole.trajectories, parts.trajectories, strict=True):
        assert (one.slot, one.status) == (other.slot, other.status)
        for name in ("time", "position", "velocity", "control", "delta_v", "sun_angle", "inspected_at"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.parametrize("policy", [RandomThrust(), NaturalMotionInspector()])
def test_a_scripted_policy_flies_on_alike_when_half_of_a_batch_has_ended(policy, monkeypatch, tmp_path):
    spec = load_spec("safe_inspect/TranslationalInspectionSeed-v0", ["horizon=700"])
    sizes, step = set(), TeamEnvironment.step
    monkeypatch.setattr(TeamEnvironment, "step", lambda self, actions: sizes.add(self.num_envs) or step(self, actions))
    metrics = default_metrics(spec)
    shrinking, whole = (rollout(spec, policy, 34, 5, size, metrics=metrics) for size in (34, 16))
    assert {34, 32, 16} <= sizes
    assert_equal(shrinking, whole, tmp_path)


def test_fewer_episodes_are_the_first_of_more(spec):
    more, fewer = (rollout(spec, RandomThrust(), episodes=count, seed=2, num_envs=8) for count in (6, 3))
    np.testing.assert_array_equal(fewer.returns, more.returns[:3])


def test_an_episode_is_that_of_the_environment_stepped_by_hand(spec):
    flown = rollout(spec, lambda observation: np.full((len(observation), 3), 0.4), episodes=3, seed=9, record=3)
    environment = BatchedEnvironment(spec, 1, seed=9, first_slot=2)
    environment.reset()
    total, spent, steps, terms = 0.0, 0.0, 0, dict.fromkeys(flown.terms, 0.0)
    while True:
        transition = environment.step(np.full((1, 1, 3), 0.4))
        total, steps = total + transition.reward[0, 0], steps + 1
        spent += float(transition.step.delta_v[0])
        for name in terms:
            terms[name] += transition.terms[name][0, 0]
        if transition.done[0, 0]:
            break
    assert (flown.returns[2], flown.length[2], flown.status[2]) == (total, steps, transition.status[0, 0])
    assert {name: values[2] for name, values in flown.terms.items()} == terms
    assert flown.delta_v[2] == pytest.approx(spent, rel=1e-12)
    np.testing.assert_array_equal(flown.trajectories[2].position[-1, 0], environment.state.position[0, 0])


def test_a_recording_agrees_with_the_figures_of_its_episode(spec):
    flown = rollout(spec, RandomThrust(), episodes=4, seed=1, record=2)
    assert len(flown.trajectories) == 2
    for index, one in enumerate(flown.trajectories):
        steps = flown.length[index]
        assert one.slot == index
        assert one.status == flown.status[index]
        assert one.position.shape == (steps + 1, 1, 3)
        assert one.control.shape == (steps, 1, 3)
        np.testing.assert_allclose(one.time, 10.0 * np.arange(steps + 1))
        assert one.coverage[-1] == flown.inspected_fraction[index]
        assert np.isfinite(one.inspected_at).mean() == flown.inspected_fraction[index]
        spent = np.abs(one.control[:, 0]).sum(axis=-1).cumsum() * 10.0 / 12.0
        np.testing.assert_allclose(one.delta_v[1:, 0], spent)
        np.testing.assert_allclose(np.diff(one.sun_angle), 0.01027)


def test_a_recording_cut_short_is_one_that_still_runs(spec):
    whole = rollout(spec, ZeroThrust(), episodes=1, seed=1, record=1).trajectories[0]
    part = whole.until(205.0)
    assert part.time[-1] == 200.0
    assert part.status is DoneStatus.RUNNING
    assert len(part.control) == 20
    assert part.coverage[-1] == whole.coverage[20]
    assert whole.until(1e9) is whole


def test_the_sums_of_the_terms_are_the_return(spec):
    flown = rollout(spec, RandomThrust(), episodes=20, seed=4)
    np.testing.assert_allclose(sum(flown.terms.values()), flown.returns, rtol=1e-12)
    np.testing.assert_allclose(flown.terms["ObservedPointsReward"], flown.inspected_fraction, rtol=1e-12)


def test_statuses_tell_losses_from_draws():
    spec = load_spec("safe_inspect/TranslationalInspectionSeed-v0", ["config.config.env_config.horizon=3"])
    drawn = rollout(spec, ZeroThrust(), episodes=5, seed=0)
    assert drawn.status.tolist() == [DoneStatus.DRAW] * 5
    assert drawn.length.tolist() == [3] * 5
    assert not drawn.success.any()
    spec = load_spec("safe_inspect/TranslationalInspectionSeed-v0")
    lost = rollout(spec, lambda observation: np.ones((len(observation), 3)), episodes=5, seed=0)
    assert lost.status.tolist() == [DoneStatus.LOSE] * 5


def test_the_policy_sees_each_row_from_its_first_observation_on(spec):
    seen = []

    class Note:
        def begin(self, flight: Flight) -> None:
            seen.append(flight.slots.tolist())
            assert flight.action.names == ("X Thrust", "Y Thrust", "Z Thrust")

        def __call__(self, observation):
            assert observation.dtype == np.float32
            assert observation.shape == (len(seen[-1]), 11)
            return np.ones((len(observation), 3))

    rollout(spec, Note(), episodes=5, num_envs=2)
    assert seen == [[0, 1], [2, 3], [4]]


def test_progress_grows_to_the_number_of_episodes(spec):
    told = []
    rollout(spec, RandomThrust(), episodes=9, num_envs=4, progress=lambda done, total: told.append((done, total)))
    counts = [done for done, _ in told]
    assert counts == sorted(set(counts))
    assert told[-1] == (9, 9)


@pytest.mark.parametrize("wrong", [{"episodes": 0}, {"num_envs": 0}, {"record": -1}])
def test_numbers_out_of_range_are_refused(spec, wrong):
    with pytest.raises(ValueError, match="at least 1"):
        rollout(spec, ZeroThrust(), **wrong)


def test_actions_of_another_shape_are_refused(spec):
    with pytest.raises(ValueError, match=r"shape \(2, 4\); expected \(2, 3\)"):
        rollout(spec, lambda observation: np.zeros((2, 4)), episodes=2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("safe_inspect/Docking-v0", ZeroThrust()), "a task must be an EnvironmentSpec, got 'safe_inspect/Docking-v0'"),
        ((None, ZeroThrust), r"the policy .*ZeroThrust'> cannot be called .*; give an object, ZeroThrust\(...\)"),
        ((None, "inspector"), "the policy 'inspector' cannot be called with observations"),
        ((None, {"blue0_ctrl": None}), "the policy None cannot be called with observations"),
    ],
)
def test_a_task_and_a_policy_are_objects(spec, arguments, message):
    task, policy = arguments
    with pytest.raises(ArgumentError, match=message):
        rollout(spec if task is None else task, policy, episodes=1)


def test_a_metric_is_an_object(spec):
    with pytest.raises(ArgumentError, match=r"a metric must be an object .* got 'SmallestRange'"):
        rollout(spec, ZeroThrust(), episodes=1, metrics=["SmallestRange"])


class Drawing:
    """Burns and coasts of each row that are functions of its slot, its deputy, the step and the observation."""

    def begin(self, flight):
        self.rows, self.step, self.asked = flight.slots * 10 + flight.deputies, 0, []
        self.coasts = flight.action.coast is not None

    def actions(self, observation, rows, step):
        numbers = self.rows[rows] * 7 + step * 13 + (observation[:, 0] > 0.0)
        burns = (numbers[:, None] + np.arange(3)) % 5 / 2.0 - 1.0
        return np.concatenate((burns, (numbers % 5)[:, None]), axis=1) if self.coasts else burns

    def __call__(self, observation):
        self.step += 1
        return self.actions(observation, np.arange(len(observation)), self.step - 1)


class Deciding(Drawing):
    """The same, asked only for the rows that take an action."""

    def decide(self, observation, rows, step):
        assert np.isfinite(observation).all()
        self.asked.append(len(rows))
        return self.actions(observation, rows, step)


@pytest.mark.parametrize(
    "task",
    [
        "translational-inspection/experiment-burn-and-coast.yml",
        "multiagent-translational-inspection/experiment-burn-and-coast.yml",
        "translational-inspection/experiment-seed.yml",
    ],
)
def test_a_policy_that_is_asked_for_decisions_alone_flies_the_same_episodes(task, monkeypatch, tmp_path):
    thrust = "X Thrust.config.properties={low: -2 N, high: 2 N}"
    spec = load_spec(configs_root() / task, ["horizon=150", *[thrust][: "burn" in task]])
    sizes, step = set(), TeamEnvironment.step
    monkeypatch.setattr(TeamEnvironment, "step", lambda self, actions: sizes.add(self.num_envs) or step(self, actions))
    flown, metrics = [], default_metrics(spec)
    for policy in (Drawing(), deciding := Deciding()):
        sizes.clear()
        flown.append(rollout(spec, policy, 40, 3, 40, metrics=metrics))
    assert sizes == ({40} if "multiagent" in task else {40, 32, 16})  # all of the team fly to the time limit
    assert sum(deciding.asked) < flown[0].length.max() * 40 * len(spec.agents) * 0.8
    assert_equal(*flown, tmp_path)
