"""Sensors of what is left and what lies ahead: by hand, and in the environments that use them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.dynamics.cwh import transition
from safe_inspect.environments import BatchedEnvironment, TeamEnvironment
from safe_inspect.errors import ConfigError
from safe_inspect.platforms.outlook_sensors import CoastingRangeSensor, CoastingTimeToLimitsSensor, TimeLeftSensor
from safe_inspect.platforms.point_sensors import (
    UninspectedPointsMapSensor,
    UninspectedPointsMomentsSensor,
    _turn_moments,
)

N = 0.001027
ORBIT = 2.0 * math.pi / N
TASK = configs_root() / "translational-inspection" / "experiment-outlook.yml"
PARTS = "agent_config.0.config.config.parts"
MOMENTS = "Sensor_UninspectedPointsMoments"


def coasting(position, velocity, duration: float = ORBIT) -> tuple[float, float]:
    """Return closest and farthest range by the transition matrix, every second."""
    state = np.array([*position, *velocity])
    ranges = [np.linalg.norm((transition(N, 12.0, t)[0] @ state)[:3]) for t in np.arange(0.0, duration, 1.0)]
    return min(ranges), max(ranges)


class TestCoastingRange:
    def read(self, fixed_start, position, velocity, **fields):
        env = BatchedEnvironment(fixed_start(position, velocity))
        env.reset()
        return CoastingRangeSensor(**fields)(env.view())[0]

    def test_at_rest_along_the_track_it_stays(self, fixed_start):
        assert self.read(fixed_start, (0.0, 70.0, 0.0), (0.0, 0.0, 0.0)).tolist() == pytest.approx([70.0, 70.0])

    def test_a_closed_ellipse(self, fixed_start):
        """From x with v_y = -2 n x the deputy flies a centred ellipse of half axes x and 2 x."""
        found = self.read(fixed_start, (50.0, 0.0, 0.0), (0.0, -2.0 * N * 50.0, 0.0))
        np.testing.assert_allclose(found, [50.0, 100.0], rtol=1e-9)

    def test_against_the_transition_matrix(self, fixed_start):
        generator = np.random.default_rng(4)
        for duration in (ORBIT, 3.0 * ORBIT, 200.0):
            for _ in range(6):
                position, velocity = generator.uniform(-80.0, 80.0, 3), generator.uniform(-0.2, 0.2, 3)
                found = self.read(fixed_start, position, velocity, duration=duration)
                near, far = coasting(position, velocity, duration)
                assert near - 0.5 <= found[0] <= near + 1e-9  # the table is constant between its seconds
                assert far - 1e-9 <= found[1] <= far + 0.5


class TestCoastingTimeToLimits:
    def test_episodes_without_thrust_end_when_it_says(self):
        env = BatchedEnvironment(load_experiment(TASK).spec, 128, seed=3)
        env.reset()
        sensor = CoastingTimeToLimitsSensor(duration=6100.0)  # 610 control steps
        told = sensor(env.view()) * 610
        length = np.zeros(128, dtype=int)
        state = env.state.position[:, 0].copy(), env.state.velocity[:, 0].copy()
        steps = [transition(N, 12.0, 10.0 * k)[0] for k in range(1, 611)]
        flown = np.array([step[:3] @ np.concatenate(state, axis=1).T for step in steps])  # (610, 3, 128)
        ranges = np.linalg.norm(flown, axis=1)
        for column, over in enumerate((ranges < 10.0, ranges > 800.0)):
            wanted = np.where(over.any(axis=0), over.argmax(axis=0) + 1, 610)
            np.testing.assert_allclose(told[:, column], wanted)
            assert 0 < (wanted < 610).sum() < 128
        coast = np.ones((128, 1, env.action_layout.size))  # the middle of three levels of thrust
        for step in range(1, 101):
            done = env.step(coast).done[:, 0]
            length = np.where((length == 0) & done, step, length)
        crashed = (told[:, 0] <= 100) & (told[:, 0] <= told[:, 1])
        assert crashed.any()
        np.testing.assert_array_equal(length[crashed], told[crashed, 0].round())


class TestTimeLeft:
    def test_it_falls_from_one_to_zero(self, fixed_start):
        env = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0)))
        env.reset()
        assert TimeLeftSensor()(env.view())[0, 0] == 1.0
        for _ in range(3):
            env.step(np.zeros((1, 1, 3)))
        assert TimeLeftSensor(horizon=4)(env.view())[0, 0] == 0.25
        assert TimeLeftSensor(horizon=2)(env.view())[0, 0] == 0.0

    def test_the_horizon_is_that_of_the_task(self):
        spec = load_experiment(TASK, ["horizon=300"]).spec
        assert spec.agents[0].sensors["Sensor_TimeLeft"].horizon == 300
        own = f"{PARTS}.Sensor_TimeLeft={{part: Sensor_TimeLeft, config: {{horizon: 100}}}}"
        given = load_experiment(TASK, ["horizon=300", own]).spec
        assert given.agents[0].sensors["Sensor_TimeLeft"].horizon == 100


class TestUninspectedPoints:
    def test_the_map_has_the_points_that_are_left(self, fixed_start):
        env = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0), sun_angle=0.3))
        env.reset()
        view = env.view()
        inspected = view.points("chief").inspected[0]
        assert 0 < inspected.sum() < 100
        np.testing.assert_array_equal(UninspectedPointsMapSensor()(view)[0], 1.0 - inspected)

    def test_the_map_has_as_many_elements_as_the_body_points(self):
        few = "env_config.simulator.config.inspection_points_map.chief={num_points: 100, points_algorithm: cmu}"
        env = BatchedEnvironment(load_experiment(TASK, [few]).spec)
        env.reset()
        count = env.view().points("chief").num_points
        assert sum("uninspected_" in name for name in env.observation_layout.names) == count == 99

    def test_a_wrong_number_of_points_is_a_mistake_of_the_configuration(self, fixed_start):
        wrong = f"{PARTS}.Sensor_UninspectedPointsMap={{part: Sensor_UninspectedPointsMap, config: {{num_points: 50}}}}"
        with pytest.raises(ConfigError, match="`num_points` is 50, but 'chief' has 100 points; remove"):
            load_experiment(TASK, [wrong])
        env = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0)))
        env.reset()
        with pytest.raises(ValueError, match="has 100 points"):
            UninspectedPointsMapSensor(num_points=50)(env.view())

    def test_moments(self):
        moments = f"{PARTS}.Sensor_TimeLeft={{part: {MOMENTS}, config: {{name: Sensor_TimeLeft}}}}"
        env = BatchedEnvironment(load_experiment(TASK, [moments]).spec, 3, seed=2)
        env.reset()
        for _ in range(10):
            env.step(np.full((3, 1, 3), 1.0))
        view = env.view()
        points, found = view.points("chief"), view.reading("Sensor_TimeLeft")
        units = points.model.points / points.model.radius
        for row in range(3):
            for kind, bright in enumerate((points.lit[row], ~points.lit[row])):
                left = units[bright & ~points.inspected[row]]
                assert len(left) > 3
                second = left.T @ left / len(left)
                expected = [len(left) / 100, *left.mean(axis=0), *second.diagonal(), *second[0, 1:], second[1, 2]]
                np.testing.assert_allclose(found[row, 10 * kind : 10 * kind + 10], expected, atol=1e-12)

    def test_nothing_left_reads_zero(self, fixed_start):
        only = "env_config.simulator.config.inspection_points_map.chief.num_points=1"
        parts = f"{PARTS}.Sensor_SunAngle={{part: {MOMENTS}, config: {{name: Sensor_SunAngle}}}}"
        env = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0), overrides=[only, parts]))
        env.reset()
        assert env.view().points("chief").inspected.all()
        assert not env.view().reading("Sensor_SunAngle").any()

    def test_moments_of_a_rotating_chief_turn_into_the_frame_of_hill(self):
        generator = np.random.default_rng(1)
        units = generator.normal(size=(7, 3))
        units /= np.linalg.norm(units, axis=1)[:, None]
        orientation = generator.normal(size=4)
        orientation /= np.linalg.norm(orientation)
        x, y, z, w = orientation
        matrix = np.array([
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ])  # fmt: skip

        def moments(vectors):
            second = vectors.T @ vectors / 7
            return np.tile([0.07, *vectors.mean(axis=0), *second.diagonal(), *second[0, 1:], second[1, 2]], 2)

        turned = np.empty(20)
        _turn_moments(orientation, moments(units), turned)
        np.testing.assert_allclose(turned, moments(units @ matrix.T), atol=1e-12)


TEAM = """
- !include configs/multiagent-translational-inspection/experiment-see-others.yml
- "blue#_ctrl":
    config:
      - !include configs/translational-inspection/agent.yml
      - config:
          parts+: !include configs/parts/outlook-sensors-compact.yml
          glues+: !include configs/parts/outlook-glues-compact.yml
"""


def test_several_deputies_each_see_their_own_and_the_common_points(tmp_path):
    (tmp_path / "team.yml").write_text(TEAM)
    env = TeamEnvironment(load_experiment(tmp_path / "team.yml").spec, 4, seed=3)
    observation = env.reset()[0]
    names = env.groups[0].observation_layout.names
    assert env.groups[0].fused.called_in_python == ()
    assert env.groups[0].size == 3
    share = observation[..., names.index("Sensor_UninspectedPointsMoments.share_dark")]
    assert (share == share[:, :1]).all()  # binary light and common points
    closest = observation[..., names.index("Sensor_CoastingRange.closest")]
    assert len(np.unique(closest)) == 12


def test_the_sensors_read_the_same_in_a_batch_and_alone():
    spec = load_experiment(TASK).spec
    batch, alone = BatchedEnvironment(spec, 5, seed=9), BatchedEnvironment(spec, 1, seed=9, first_slot=3)
    assert batch.reset()[3].tobytes() == alone.reset()[0].tobytes()
    for step in range(20):
        action = np.full((5, 1, 3), step % 3.0)
        assert batch.step(action).observation[3].tobytes() == alone.step(action[:1]).observation[0].tobytes()


@pytest.mark.parametrize("sensor", [UninspectedPointsMapSensor, UninspectedPointsMomentsSensor])
def test_what_a_body_without_points_gives(sensor):
    docking = configs_root() / "docking" / "experiment.yml"
    with pytest.raises(ConfigError, match="no body with inspection points is named 'chief'"):
        load_experiment(docking, [f"{PARTS}.3={{part: {sensor().registered_name}}}"])
