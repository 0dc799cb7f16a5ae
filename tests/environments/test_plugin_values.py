"""A plugin that gives NaN, infinity or a wrong shape stops the run: its name, and the state that caused it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from safe_inspect.config.experiment import load_experiment
from safe_inspect.dones import DoneFunction, DoneStatus
from safe_inspect.environments import BatchedEnvironment, TeamEnvironment, make, make_vec
from safe_inspect.errors import PluginValueError
from safe_inspect.platforms import Controller, Sensor
from safe_inspect.plugins.registry import registry
from safe_inspect.rewards import Reward
from safe_inspect.simulators import Initializer

AGENT = "agent_config.0.config.config"


@pytest.fixture
def crash_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "not" / "yet"
    monkeypatch.setenv("SAFE_INSPECT_CRASH_FOLDER", str(folder))
    return folder


@pytest.fixture
def registered() -> Iterator[None]:
    """Forget the plugins that a test defines."""
    before = {kind: dict(registry.items(kind)) for kind in registry.kinds()}
    yield
    for kind, classes in before.items():
        registry._classes[kind] = classes


def saved(folder: Path, when: str) -> dict[str, np.ndarray]:
    (path,) = folder.glob(f"state_{when}_*.npz")
    with np.load(path) as arrays:
        return dict(arrays)


@pytest.mark.usefixtures("registered")
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_reward_is_named_and_its_states_are_saved(shipped, crash_folder, value):
    class FaultyReward(Reward):
        """NaN from the third step on, in the rows of one side."""

        def __call__(self, step):
            """Return the faulty values."""
            return np.where((step.after.step >= 3) & (step.after.position[:, 0] > 0.0), value, 0.0)

    spec = load_experiment(shipped, [f"{AGENT}.rewards.1={{name: mine, functor: FaultyReward}}"]).spec
    env = BatchedEnvironment(spec, 8, seed=1)
    env.reset()
    still = np.zeros((8, 1, 3))
    env.step(still)
    env.step(still)
    with pytest.raises(PluginValueError, match="reward mine gave") as caught:
        env.step(still)
    bad = env.state.position[:, 0, 0] > 0.0
    assert 0 < bad.sum() < 8
    assert f"in environment {np.flatnonzero(bad)[0]}, step 3 ({bad.sum()} of 8" in str(caught.value)
    after, before = saved(crash_folder, "after"), saved(crash_folder, "before")
    assert str(crash_folder) in str(caught.value)
    np.testing.assert_array_equal(after["position"], env.state.position[bad])
    np.testing.assert_array_equal(after["points.chief.inspector"], env.state.points["chief"].inspector[bad])
    np.testing.assert_array_equal(before["step"], [2] * bad.sum())
    np.testing.assert_array_equal(after["step"], [3] * bad.sum())


@pytest.mark.usefixtures("registered", "crash_folder")
def test_a_sensor_that_is_observed_is_named(shipped):
    class FaultySensor(Sensor):
        """Always NaN."""

        elements = ("broken",)

        def __call__(self, view):
            """Return NaN."""
            return np.full((view.num_rows, 1), np.nan)

    glue = f"{AGENT}.glues.5={{functor: ObserveSensor, config: {{sensor: FaultySensor}}}}"
    env = make(shipped, [glue, f"{AGENT}.parts.5={{part: FaultySensor}}"])
    with pytest.raises(PluginValueError, match=r"FaultySensor\.broken.* gave \[nan\]"):
        env.reset(seed=0)


@pytest.mark.usefixtures("registered", "crash_folder")
def test_a_sensor_that_only_a_done_reads_is_named(shipped):
    """A NaN range would compare as neither too near nor too far, and no episode would ever end."""

    class LostReference(Sensor):
        """A position sensor that is lost after a step."""

        elements = ("x", "y", "z")

        def __call__(self, view):
            """Return NaN from the first step on."""
            return np.where(view.step[:, None] > 0, np.nan, np.zeros((view.num_rows, 3)))

    env = make(shipped, [f"{AGENT}.parts.8={{part: LostReference, config: {{name: reference_position}}}}"])
    env.reset(seed=0)
    with pytest.raises(PluginValueError, match="sensor reference_position"):
        env.step(np.zeros(3))


@pytest.mark.usefixtures("registered", "crash_folder")
def test_a_controller_is_named(shipped):
    class FaultyController(Controller):
        """Thrust that is NaN for a positive command."""

        @property
        def limits(self):
            return np.array([-1.0]), np.array([1.0])

        def __call__(self, values):
            """Return the square root of the negative command."""
            return np.repeat(np.where(values > 0.0, np.nan, values), 3, axis=1)

    env = make(shipped, [f"{AGENT}.parts.1={{part: FaultyController, config: {{name: Y Thrust}}}}"])
    env.reset(seed=0)
    env.step(np.array([0.1, -0.1, 0.0]))
    with pytest.raises(PluginValueError, match=r"glue ControllerGlue \(Y Thrust\) gave"):
        env.step(np.array([0.1, 0.1, 0.0]))


@pytest.mark.usefixtures("registered", "crash_folder")
def test_an_initialiser_is_named_by_what_it_gives(fixed_start, shipped):
    class FaultyInitializer(Initializer):
        """A velocity that is infinite."""

        def __call__(self, values):
            """Return the states."""
            return {"position": np.full((3, 3), 50.0), "velocity": np.full((3, 3), np.inf)}

    start = f"{AGENT}.simulator_reset_parameters={{initializer: {{functor: FaultyInitializer}}}}"
    sun = "sun.config.theta.config.attribute_name=init_state.sun_angle"
    with pytest.raises(PluginValueError, match="initialiser of the velocity"):
        BatchedEnvironment(load_experiment(shipped, [start, sun]).spec, 3).reset()


@pytest.mark.usefixtures("registered", "crash_folder")
def test_a_wrong_shape_is_named(shipped):
    class ColumnReward(Reward):
        """A column, which would broadcast over the rows."""

        def __call__(self, step):
            """Return shape (R, 1)."""
            return step.after.range_to(None)[:, None]

    class ScalarDone(DoneFunction):
        """One answer for all rows."""

        status = DoneStatus.LOSE

        def __call__(self, step):
            """Return a scalar."""
            return bool((step.after.range_to(None) > 1e9).any())

    class LongSensor(Sensor):
        """More elements than it declares."""

        elements = ("one",)

        def __call__(self, view):
            """Return shape (R, 3)."""
            return view.position

    zeros = np.zeros((2, 3))
    env = make_vec(shipped, 2, [f"{AGENT}.rewards.0={{functor: ColumnReward}}"])
    env.reset()
    with pytest.raises(PluginValueError, match=r"reward ColumnReward gave an array of shape \(2, 1\).*\(2,\)"):
        env.step(zeros)
    env = make_vec(shipped, 2, [f"{AGENT}.dones.0={{functor: ScalarDone}}"])
    env.reset()
    with pytest.raises(PluginValueError, match=r"done ScalarDone gave an array of shape \(\)"):
        env.step(zeros)
    glue = f"{AGENT}.glues.5={{functor: ObserveSensor, config: {{sensor: LongSensor}}}}"
    env = make_vec(shipped, 2, [f"{AGENT}.parts.5={{part: LongSensor}}", glue])
    with pytest.raises(PluginValueError, match=r"LongSensor\.one.* shape \(2, 3\).*\(2, 1\)"):
        env.reset()


@pytest.mark.usefixtures("registered")
def test_a_reward_that_hands_out_the_state_itself_does_not_change_it(shipped):
    """The façades write into the terms of environments that they reset."""

    class SpentReward(Reward):
        """The delta-v of the episode: the state's own array."""

        def __call__(self, step):
            """Return the array."""
            return step.after.delta_v

    spec = load_experiment(shipped, [f"{AGENT}.rewards.0={{functor: SpentReward}}"]).spec
    env = BatchedEnvironment(spec, 2)
    env.reset()
    terms = env.step(np.ones((2, 1, 3))).terms["SpentReward"]
    spent = env.state.delta_v.copy()
    assert (spent > 0.0).all()
    terms[...] = 0.0
    np.testing.assert_array_equal(env.state.delta_v, spent)


def test_an_action_that_is_nan_is_refused(shipped, crash_folder):
    env = make(shipped)
    env.reset(seed=0)
    with pytest.raises(PluginValueError, match="action of blue0_ctrl gave"):
        env.step(np.array([0.0, np.nan, 0.0]))
    assert saved(crash_folder, "after")["step"] == [0]


@pytest.mark.usefixtures("registered")
def test_a_reward_that_gives_words_is_named(shipped):
    class WordyReward(Reward):
        """Give a word."""

        def __call__(self, step):
            """Give it."""
            return "much"

    spec = load_experiment(shipped, [f"{AGENT}.rewards.1={{functor: WordyReward}}"]).spec
    for fused in (True, False):
        env = TeamEnvironment(spec, 2, seed=1, _fused=fused)
        env.reset()
        with pytest.raises(PluginValueError, match="reward WordyReward gave 'much'; expected an array of numbers"):
            env.step([np.zeros((2, 1, 3))])


@pytest.mark.usefixtures("registered")
def test_a_reward_that_returns_nothing_is_named(shipped):
    class ForgetfulReward(Reward):
        """Return nothing."""

        def __call__(self, step):
            """Forget to return."""

    env = make_vec(shipped, 2, [f"{AGENT}.rewards.1={{functor: ForgetfulReward}}"])
    env.reset()
    with pytest.raises(PluginValueError, match="reward ForgetfulReward gave None; return an array of numbers"):
        env.step(np.zeros((2, 3)))


@pytest.mark.usefixtures("registered")
def test_a_plugin_that_raises_is_named_with_its_line(shipped):
    class RaisingReward(Reward):
        """Divide by zero."""

        def __call__(self, step):
            """Fail."""
            return 1 / 0

    spec = load_experiment(shipped, [f"{AGENT}.rewards.1={{functor: RaisingReward}}"]).spec
    env = BatchedEnvironment(spec, 2, seed=1)
    env.reset()
    with pytest.raises(ZeroDivisionError) as caught:
        env.step(np.zeros((2, 1, 3)))
    (note,) = caught.value.__notes__
    assert note.startswith("raised in the reward RaisingReward (")
    assert f"{Path(__file__).name}:" in note
