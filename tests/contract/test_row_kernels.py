"""Plugins that a row kernel defines: the test kit holds them to the contract, and the fused step calls them."""

from __future__ import annotations

import copy
import re
from typing import ClassVar

import cloudpickle
import numpy as np
import pytest

from safe_inspect.compiling import njit
from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.dones import DoneFunction, DoneStatus
from safe_inspect.environments import TeamEnvironment
from safe_inspect.errors import PluginValueError
from safe_inspect.platforms import Sensor
from safe_inspect.rewards import Reward
from safe_inspect.simulators.row_terms import EnvironmentArray, Intervening, OwnArray, RowTerm, SensorReading
from safe_inspect.testing import check_plugin

from .reports import breaches

pytestmark = pytest.mark.usefixtures("clean_registry")


@njit
def _height(scale, position):
    return scale * position[2]


@njit
def _sink(position):
    position[2] -= 1.0
    return position[2]


@njit
def _half(position, reading):
    reading[0] = position[0]


@njit
def _fail(position):
    if position[0] > -1e9:
        raise ValueError("no")
    return 0.0


@njit
def _opens(position):
    with open("file") as file:
        return float(file.read())


@njit
def _text(position):
    return "text"


@njit
def _is_above(limit, reading):
    return reading[0] > limit


def test_a_good_one_passes():
    class HeightReward(Reward):
        """Pay for height.

        Attributes:
            scale: Reward of a metre [1/m].
        """

        scale: float = 0.5

        def row(self, world, group):
            return RowTerm(_height, (self.scale, OwnArray("position")))

    check_plugin(HeightReward)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize(
    ("kernel", "text"),
    [
        (_sink, "the reward changed step.after's position"),
        (_fail, "the row kernel of reward BadReward raised an exception"),
        (_text, r"_text does not compile as a row kernel of \(float64\[:\]\)"),
        (_opens, r"_opens does not compile as a row kernel of \(float64\[:\]\)"),
        (len, "the kernel len of a RowTerm is not compiled; decorate it with safe_inspect.compiling.njit"),
    ],
)
def test_bad_kernels_are_found(kernel, text):
    class BadReward(Reward):
        """Something."""

        def row(self, world, group):
            return RowTerm(kernel, (OwnArray("position"),))

    assert re.search(text, "".join(breaches(BadReward).values()))


def test_a_reading_that_is_not_written_in_full_is_found():
    class HalfSensor(Sensor):
        """Two numbers, of which one is written."""

        elements: ClassVar = ("x", "y")

        def row(self, world, group):
            return RowTerm(_half, (OwnArray("position"),))

    assert "finite" in breaches(HalfSensor)


def test_a_sensor_sees_no_step():
    class StepSensor(Sensor):
        """Whether a filter acted."""

        elements: ClassVar = ("x",)

        def row(self, world, group):
            return RowTerm(_half, (Intervening(),))

    assert re.search("a sensor sees one state, and no step", "".join(breaches(StepSensor).values()))


def test_a_kernel_beside_another_batch_call_is_found():
    class TwoReward(Reward):
        """Two definitions."""

        def row(self, world, group):
            return RowTerm(_height, (1.0, OwnArray("position")))

        def __call__(self, step):
            return 2.0 * step.after.position[:, 2]

    assert "row kernel" in breaches(TwoReward)


def test_an_array_that_the_task_has_not_is_one_message():
    class WindReward(Reward):
        """Of an array that is missing."""

        def row(self, world, group):
            return RowTerm(_height, (1.0, EnvironmentArray("wind")))

    assert re.search("the state of this task has no 'wind'", "".join(breaches(WindReward).values()))


@pytest.mark.parametrize("num_envs", [1, 7])
def test_a_kernel_is_given_what_a_numpy_sensor_reads(num_envs):
    class SpeedSensor(Sensor):
        """The own speed, in NumPy."""

        elements: ClassVar = ("speed",)

        def __call__(self, view):
            return np.sqrt((view.velocity**2).sum(axis=1, keepdims=True))

    class FastDone(DoneFunction):
        """Ends above a speed."""

        status = DoneStatus.LOSE

        def row(self, world, group):
            return RowTerm(_is_above, (0.9, SensorReading("SpeedSensor")))

    agent = "agent_config.0.config.config"
    words = (
        f"{agent}.parts.6={{part: SpeedSensor}}",
        f"{agent}.glues.3={{functor: ObserveSensor, config: {{sensor: SpeedSensor}}}}",
        f"{agent}.dones.1={{functor: FastDone}}",
    )
    spec = load_experiment(configs_root() / "translational-inspection" / "experiment-seed.yml", words).spec
    fused, plain = (TeamEnvironment(spec, num_envs, seed=7, _fused=fused) for fused in (True, False))
    fused.reset(), plain.reset()
    assert fused.groups[0].fused.called_in_python == ("glue ObserveSensor (SpeedSensor.speed)", "SpeedSensor")
    met = 0
    for _ in range(120):
        actions = [np.ones((num_envs, 1, 3))]
        one, other = (env.step(actions).groups[0] for env in (fused, plain))
        np.testing.assert_array_equal(one.status, other.status)
        np.testing.assert_array_equal(one.observation, other.observation)
        speed = np.linalg.norm(fused.state.velocity[:, 0], axis=1)
        assert (one.status[speed > 0.9] != 0).all()
        met += int((speed > 0.9).sum())
        rows = np.flatnonzero((one.status != 0).all(axis=1))
        if len(rows):
            fused.reset(rows), plain.reset(rows)
    assert met


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_kernel_that_raises_in_a_step_names_its_plugin():
    class FailingReward(Reward):
        """Always an error."""

        def row(self, world, group):
            return RowTerm(_fail, (OwnArray("position"),))

    words = ("agent_config.0.config.config.rewards.1={name: mine, functor: FailingReward}",)
    spec = load_experiment(configs_root() / "translational-inspection" / "experiment-seed.yml", words).spec
    env = TeamEnvironment(spec, 2, seed=7)
    env.reset()
    with pytest.raises(PluginValueError, match="the row kernel of reward FailingReward raised an exception"):
        env.step([np.zeros((2, 1, 3))])


def test_an_environment_with_a_kernel_that_no_module_holds_is_copied():
    @njit
    def local(scale, position):
        return scale * position[1]

    class LocalReward(Reward):
        """Pay for the way along y."""

        def row(self, world, group):
            return RowTerm(local, (0.5, OwnArray("position")))

    words = ("agent_config.0.config.config.rewards.1={name: mine, functor: LocalReward}",)
    spec = load_experiment(configs_root() / "translational-inspection" / "experiment-seed.yml", words).spec
    env = TeamEnvironment(spec, 2, seed=7)
    env.reset()
    copies = copy.deepcopy(env), cloudpickle.loads(cloudpickle.dumps(env))
    wanted = env.step([np.zeros((2, 1, 3))]).groups[0]
    np.testing.assert_array_equal(wanted.terms["mine"][:, 0], 0.5 * env.state.position[:, 0, 1])
    for copied in copies:
        found = copied.step([np.zeros((2, 1, 3))]).groups[0]
        assert "mine" not in copied.groups[0].fused.called_in_python
        assert found.reward.tobytes() == wanted.reward.tobytes()
