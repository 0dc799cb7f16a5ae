"""A target whose motion changes while it is watched."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from safe_inspect.dynamics.quaternion import exp, multiply
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.missions.scenario import checked_target, initial_tumbles
from safe_inspect.missions.summary import attitude_error
from safe_inspect.missions.truth import ChaserTrace, SensorSuite, estimator_context, target_motion
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.control.attitude import CameraPointing
from safe_inspect.rendezvous.estimate import BodyState, StateEstimate
from safe_inspect.rendezvous.estimation.change import departs
from safe_inspect.rendezvous.estimation.states import TargetEstimate
from safe_inspect.rendezvous.experiment import load_rendezvous
from safe_inspect.rendezvous.readings import Command

_FILE = Path(__file__).parents[3] / "configs" / "tumbling-rendezvous" / "experiment.yml"
_CHANGE, _END = 30.0, 56.0
_LEVEL = np.array([0.0, 0.0, 0.0, 1.0])


class _Seen(NamedTuple):
    """What is estimated at one time, and what is true."""

    time: float
    estimate: StateEstimate
    chaser: BodyState
    target: BodyState

    @property
    def attitude(self) -> float:
        """Error of the target's attitude as the chaser sees it [degrees]."""
        return float(np.rad2deg(np.linalg.norm(attitude_error(self.estimate, self.chaser, self.target))))

    @property
    def rate(self) -> float:
        """Error of the angular velocity [degrees/s]."""
        return float(np.rad2deg(np.linalg.norm(self.estimate.target.angular_velocity - self.target.angular_velocity)))


def _watched() -> Iterator[_Seen]:
    """Give an estimate a second, of a chaser at rest and a target that is struck at `_CHANGE`."""
    config = load_rendezvous(_FILE, ["estimator.config.front_end.functor=MeasuredPoses"]).config
    mission, target = config.mission, checked_target(config)
    streams = Streams(0, np.array([1]), np.zeros(1, np.int64))
    run = config.estimator(estimator_context(config, target, streams))
    sensors = SensorSuite(config, target, streams, config.estimator.reads)
    times = np.arange(round(_END / mission.step) + 1) * mission.step
    q, w = target_motion(target.principal, [value[0] for value in initial_tumbles(config, streams)], (_CHANGE,), times)
    still, place = np.zeros(3), np.array([0.0, -1.5, 0.0])
    chaser = BodyState(place, still, CameraPointing(_LEVEL).step(place, still, 1.0).orientation, still)
    trace = ChaserTrace(*(np.tile(array, (mission.control_ticks, 1)) for array in (*chaser, np.zeros(6))))
    for k, time in enumerate(times):
        body = BodyState(still, still, q[k], w[k])
        held = (trace, Command(still, still)) if k else ()
        estimate = run.update(sensors.read(float(time), chaser, body, *held))
        if k % 5 == 1:  # the frame of the control step before is known
            yield _Seen(float(time), estimate, chaser, body)


def test_a_change_is_noticed_and_the_new_motion_found_from_what_is_seen_after_it() -> None:
    seen = list(_watched())
    before = [one for one in seen if 20.0 <= one.time < _CHANGE]
    assert not any(one.estimate.alarm for one in before)
    alarmed = [one for one in seen if one.estimate.alarm]
    assert alarmed[0].time <= _CHANGE + 4.2  # the frame of 4 s, and a control step
    assert alarmed[-1].time >= alarmed[0].time + 10.0
    # With the alarm no plan is made, and the errors that are stated hold for what the newest frames show.
    assert all(one.estimate.problem for one in alarmed)
    assert max(one.attitude for one in alarmed) < 3.0
    assert max(one.rate for one in alarmed) < 2.0
    assert min(one.estimate.errors.attitude for one in alarmed) > np.deg2rad(2.0)
    after = [one for one in seen if one.time > alarmed[-1].time]
    assert len(after) >= 5
    assert max(one.attitude for one in after) < 2.0
    assert max(one.rate for one in after) < 0.3


def _known(inertia: np.ndarray, w: np.ndarray) -> TargetEstimate:
    sigmas = np.repeat([2e-3, 2e-4, 1e-2], [3, 3, 2])
    return TargetEstimate(
        0.0, _LEVEL, w, inertia[:2], _LEVEL, np.diag(sigmas**2), 2e-3, True, True, 1.0, 1.0, (0.0, 1.0)
    )


def test_a_departure_is_distinguished_from_frames_in_which_the_front_end_errs() -> None:
    inertia, w = np.array([0.2, 0.9, 1.0]), np.deg2rad([3.0, 2.0, 2.0])
    known, sigma, times = _known(inertia, w), np.deg2rad(0.3), np.arange(6.0, 11.0)
    expected = known.predict(times)[0]
    assert not departs(known, times, expected, sigma)
    assert not departs(known, times[:2], expected[:2], sigma)
    wrong = expected.copy()
    wrong[2:4] = multiply(wrong[2:4], exp(np.deg2rad([[6.0, 0.0, 0.0], [4.0, 0.0, 0.0]])))
    assert not departs(known, times, wrong, sigma)
    struck = tumble(inertia, expected[1][None], known.predict(times)[1][1][None] + np.deg2rad([[2.0, 0.0, 0.0]]),
                    times[1:] - times[1])[0][0]  # fmt: skip
    assert departs(known, times, np.concatenate((expected[:1], struck)), sigma)
    assert not departs(known, times, np.concatenate((expected[:1], struck)), sigma, 4.0)
    hard = tumble(inertia, expected[1][None], known.predict(times)[1][1][None] + np.deg2rad([[8.0, 0.0, 0.0]]),
                  times[1:] - times[1])[0][0]  # fmt: skip
    assert departs(known, times, np.concatenate((expected[:1], hard)), sigma, 4.0)
    assert not departs(known, times, np.concatenate((expected[:1], hard)), sigma, np.inf)
    # A small departure of the rate shows in time, by the attitude.
    slow = w[None] + np.deg2rad([[0.0, 0.4, 0.0]])
    early, late = times - 6.0, times + 10.0
    assert not departs(known, early, tumble(inertia, _LEVEL[None], slow, early)[0][0], sigma)
    assert departs(known, late, tumble(inertia, _LEVEL[None], slow, late)[0][0], sigma)


def test_views_that_the_model_explains_badly_are_no_change() -> None:
    """Errors of a flight 0.5 m from the target, whose details turn the pose for three frames."""
    known = _known(np.array([0.2, 0.9, 1.0]), np.deg2rad([3.0, 2.0, 2.0]))
    times, turns = np.arange(6.0, 12.0), np.deg2rad([0.3, 0.8, 1.4, 2.7, 1.1, 0.3])
    seen = multiply(known.predict(times)[0], exp(turns[:, None] * np.array([1.0, 0.0, 0.0])))

    def alarms(recent_misfit: float) -> bool:
        now = replace(known, recent_misfit=recent_misfit, covariance=0.1 * known.covariance)
        newest = [slice(max(k - 5, 0), k) for k in range(2, 7)]
        return any(departs(now, times[one], seen[one], np.deg2rad(0.18)) for one in newest)

    assert alarms(1.0)
    assert not alarms(1.4)
