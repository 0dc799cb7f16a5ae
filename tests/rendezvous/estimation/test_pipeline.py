"""The pipeline between its parts: what it predicts, trusts, remembers and believes, with parts that are made up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from safe_inspect.dynamics.quaternion import exp, to_matrix
from safe_inspect.rendezvous.depth_camera import DepthFrame
from safe_inspect.rendezvous.estimation import pipeline as module
from safe_inspect.rendezvous.estimation.change import motion_of
from safe_inspect.rendezvous.estimation.characteriser import KnownBody
from safe_inspect.rendezvous.estimation.estimators import PipelineEstimatorRun
from safe_inspect.rendezvous.estimation.pipeline import EstimationPipeline
from safe_inspect.rendezvous.estimation.states import ChaserStart, GraphEstimate, TargetEstimate
from safe_inspect.rendezvous.inertial_unit import ImuNoise
from safe_inspect.rendezvous.poses import MODEL, Edge, inverse, pose, rotation_log

CENTRE, CENTRE_GLUED = np.array([0.2, 0.1, -0.3]), np.array([0.05, 1.4, 0.2])
START = ChaserStart(
    pose(to_matrix(exp(np.array([0.3, -0.2, 0.5]))), np.array([0.0, -1.5, 0.1])), np.array([0.01, 0, 0])
)
T_BC = pose(to_matrix(exp(np.array([0.1, 0.4, -0.2]))), np.array([0.1, 0.0, 0.05]))
T_GM = pose(to_matrix(exp(np.array([0.2, 0.9, -0.4]))), CENTRE_GLUED)  # the model's origin is the centre of mass


def motion(**changes: Any) -> TargetEstimate:
    """Return a motion that turns about all its axes."""
    q_GT = exp(np.array([-0.7, 0.2, 1.1]))  # noqa: N806
    known = TargetEstimate(
        2.0, exp(np.array([0.5, 0.1, -0.3])), np.array([0.05, -0.03, 0.08]), np.array([0.4, 0.8]), q_GT,
        np.diag(np.arange(1.0, 9.0)), 1e-3, True, True, 1.0, 1.0, (0.0, 1.0),
    )  # fmt: skip
    return replace(known, **changes)


def glued(time: float, known: TargetEstimate) -> np.ndarray:
    """Return the true T_WG of a target that moves so."""
    rotation = to_matrix(known.predict(np.array([time]))[0][0]) @ to_matrix(known.q_GT).T
    return pose(rotation, CENTRE - rotation @ CENTRE_GLUED)


def chaser(time: float) -> np.ndarray:
    """Return the true T_WB of a chaser that flies past."""
    return START.pose @ pose(
        to_matrix(exp(0.02 * time * np.array([1.0, -1.0, 0.5]))), 0.01 * time * np.array([3, 2, 1])
    )


def relative(time: float, known: TargetEstimate) -> np.ndarray:
    """Return the true T_GB."""
    return inverse(glued(time, known)) @ chaser(time)


def shape(radius: float) -> Any:
    """Return a known target, as far as the pipeline reads it."""
    return SimpleNamespace(swept_radius=radius, principal=np.array([0.5, 0.8, 1.0]), R_MT=np.eye(3))


class Graph:
    """A back end that knows the truth, at a frame a second; frame 0 is at time 0."""

    def __init__(self, known: TargetEstimate, unreached: tuple[int, ...] = ()) -> None:
        self.known, self.frames, self.unreached = known, [0], unreached
        self.calls: list[Any] = []
        record = lambda name: lambda *given: self.calls.append((name, *given))  # noqa: E731
        self.imu = SimpleNamespace(
            period=0.1, rotation="turned", add=record("add"), coast=record("coast"), correct=record("correct")
        )
        self.model: Any = T_GM

    def now(self) -> Any:
        return chaser(self.time), "velocity", "rate"

    @property
    def time(self) -> float:
        return float(self.frames[-1])

    def update(self, number: int, edges: list[Edge], *, jumped: bool) -> None:
        self.frames.append(number)
        self.calls.append(("update", number, [edge.second for edge in edges], jumped))

    def estimate(self) -> GraphEstimate:
        reached = self.frames[-1] not in self.unreached
        return GraphEstimate(
            self.frames[-1], chaser(self.time), np.zeros(3), np.arange(6.0),
            relative(self.time, self.known) if reached else None, CENTRE, CENTRE_GLUED, self.model, np.eye(6),
            np.eye(3), np.eye(3),
        )  # fmt: skip

    def chaser_poses(self, count: int | None = None) -> np.ndarray:
        return np.stack([chaser(frame) for frame in self.frames[-(count or len(self.frames)) :]])

    def relative_poses(self, count: int | None = None) -> dict[int, np.ndarray]:
        frames = self.frames[-(count or len(self.frames)) :]
        return {frame: relative(frame, self.known) for frame in frames if frame not in self.unreached}


def frame(time: float, points: Any = ()) -> DepthFrame:
    return DepthFrame(time, np.zeros((0, 0)), np.reshape(points, (-1, 3)), np.zeros((0, 0), bool), ())


def edge(second: int, first: int = MODEL, time: float | None = None, known: TargetEstimate | None = None) -> Edge:
    """Return an exact edge to a frame."""
    here = relative(float(second) if time is None else time, known or motion())
    origin = T_GM if first == MODEL else relative(float(first), known or motion())
    return Edge(first, second, inverse(origin) @ here, np.diag([1e-4] * 3 + [1e-4, 9e-4, 4e-4]), 1.0, "model")


class Flight:
    """A pipeline with its made-up parts.

    Attributes:
        edges: What the front end gives for each frame, by number.
        found: What the characterisation finds, for its arguments.
        fits: Arguments of the characterisation.
    """

    def __init__(
        self, edges: Callable[[int], list[Edge]] = lambda number: [edge(number)] if number else [], target: Any = None
    ) -> None:
        self.graph, self.edges, self.predicted = Graph(motion()), edges, list[Any]()
        self.found: Callable[..., Any] = lambda *given: None
        self.fits, self.priors = list[Any](), list[Any]()
        self.target = target
        self._pipeline: EstimationPipeline | None = None

    @property
    def pipeline(self) -> EstimationPipeline:
        assert self._pipeline is not None, "it begins with the first frame"
        return self._pipeline

    def _back_end(self, _: Any, *given: Any) -> Any:
        self.priors.append(given)
        return self.graph

    def _step(self, shown: DepthFrame, predicted: Any, rotation: Any) -> list[Edge]:
        self.predicted.append((predicted, rotation))
        return self.edges(len(self.predicted) - 1)

    def _fit(self, *given: Any) -> Any:
        self.fits.append(given)
        return self.found(*given)

    def see(self, *times: float) -> EstimationPipeline:
        for time in times:
            self.show(frame(time))
        return self.pipeline

    def show(self, shown: DepthFrame) -> None:
        if self._pipeline is not None:
            self._pipeline.see(shown)
            return
        step: Any = SimpleNamespace(step=self._step)
        context: Any = SimpleNamespace(target=self.target, T_BC=T_BC)
        unit: Any = SimpleNamespace(noise=ImuNoise())
        made: Any = (step, self._back_end, self._fit, context, unit, START, shown)
        self._pipeline = EstimationPipeline(*made)


def test_samples_and_commands_go_to_the_back_end() -> None:
    flight = Flight()
    flight.see(0.0)
    np.testing.assert_array_equal(flight.pipeline.now()[0], chaser(0.0))
    assert flight.pipeline.now()[1:] == ("velocity", "rate")
    ((start, _),) = flight.priors
    assert start is START
    assert flight.predicted[0][0] is None
    np.testing.assert_array_equal(flight.predicted[0][1], np.eye(3))
    jumps = SimpleNamespace(
        check=lambda *given: checks.append(given), settle=lambda: checks.append("settle"),
    )  # fmt: skip
    checks, flight.pipeline._bias_jumps = list[Any](), jumps  # type: ignore[assignment]
    expected: Any = SimpleNamespace(mean=np.arange(6.0))
    flight.pipeline.measure("acceleration", "rate", 0.1)  # type: ignore[arg-type]
    flight.pipeline.move([], expected, 0.2)
    assert flight.graph.calls.pop(0) == ("add", "acceleration", "rate", 0.1)
    assert flight.graph.calls == [("coast", 0.2, expected.mean)]
    assert not checks  # the bias is not known before the second frame
    flight.see(1.0)
    assert flight.predicted[1] == (None, "turned")
    samples: Any = [SimpleNamespace(acceleration=k, rate=-k) for k in (1, 2)]
    flight.graph.calls.clear()
    flight.pipeline.move(samples, expected, 0.1)
    assert flight.graph.calls == [("add", 1, -1, 0.1), ("add", 2, -2, 0.1)]
    assert checks[0] == "settle"
    given, motion_, bias, duration = checks[1]
    assert (given, motion_, bias.tolist(), duration) == (samples, expected, [0.0, 1.0, 2.0], 0.1)
    jumps.check = lambda *given: "jump"
    flight.pipeline.move(samples[:1], expected, 0.1)
    assert flight.graph.calls[2:] == [("correct", "jump"), ("add", 1, -1, 0.1)]


@pytest.mark.parametrize("time", [2.0, 7.5])
def test_the_predicted_pose_is_that_of_the_motion(time: float) -> None:
    flight = Flight()
    flight.see(0.0, 1.0).target = motion()
    flight.graph.frames.append(time)  # type: ignore[arg-type]  # where the inertial unit says that it is
    found = flight.pipeline._predicted(time)
    assert found is not None
    np.testing.assert_allclose(found, relative(time, motion()), atol=1e-12)


def test_a_mismatch_is_the_distance_of_what_a_frame_shows_with_its_deviation() -> None:
    flight = Flight()
    pipeline = flight.see(0.0, 1.0, 2.0, 3.0)
    assert pipeline.mismatch == np.inf  # no motion is known
    pipeline.target = motion()
    exact = [edge(3), edge(3, first=1)]
    assert pipeline._mismatch(3.0, exact[:1]) == pytest.approx(0.03, abs=1e-9)
    assert pipeline._mismatch(3.0, exact[1:]) == pytest.approx(0.03, abs=1e-9)
    assert pipeline._mismatch(3.0, []) == np.inf
    assert pipeline._mismatch(3.0, [edge(2)]) == np.inf  # of another frame
    wrong = [replace(one, pose=one.pose @ pose(np.eye(3), np.array([0.3, 0.0, 0.4]))) for one in exact]
    assert pipeline._mismatch(3.0, [exact[0], wrong[1]]) == pytest.approx(0.53, abs=1e-9)
    assert pipeline._mismatch(3.0, [wrong[0], exact[1]]) == pytest.approx(0.53, abs=1e-9)
    assert pipeline.graph is not None
    pipeline.graph = replace(pipeline.graph, model=None)
    assert pipeline._mismatch(3.0, exact[:1]) == np.inf
    flight.graph.unreached = (1,)
    assert pipeline._mismatch(3.0, exact[1:]) == np.inf
    for time in (4.0, 5.0, 6.0, 7.0):
        flight.see(time)
        assert pipeline.mismatch == np.inf
    flight.see(8.0)
    assert pipeline.mismatch == pytest.approx(0.03, abs=1e-9)  # of the newest five frames


@pytest.mark.parametrize("known", [True, False])
def test_the_centre_is_looked_for_where_something_is_seen(known: bool) -> None:
    target = shape(2.0) if known else None
    flight = Flight(target=target)
    flight.show(frame(0.0, [[0.5, 0.0, 1.0], [0.1, 0.2, 3.0]]))
    ((_, prior),) = flight.priors
    seen = START.pose @ T_BC @ np.array([0.3, 0.1, 2.0, 1.0])
    np.testing.assert_allclose(prior.position, seen[:3], atol=1e-15)
    assert prior.sigma == 0.4 * (2.0 if known else 1.0)
    nothing = Flight(target=target)
    nothing.see(0.0)
    ((_, prior),) = nothing.priors
    np.testing.assert_allclose(
        prior.position, (START.pose @ T_BC @ np.array([0.0, 0.0, 2.6 if known else 1.3, 1.0]))[:3], atol=1e-15
    )
    assert prior.sigma == 0.6 * (2.0 if known else 1.0)


def trusted(monkeypatch: pytest.MonkeyPatch, innovations: list[list[float]], coasts: tuple[int, ...] = ()) -> Any:
    """Return for each frame after the second which edges are used, and whether a jump is reported."""
    values = [[0.0], [0.0], *innovations]
    flight = Flight(lambda number: [replace(edge(number), inliers=value) for value in values[number]])
    monkeypatch.setattr(module, "centre_innovation", lambda graph, expected, one: one.inliers)
    monkeypatch.setattr(flight.graph, "update", lambda number, edges, *, jumped: (
        flight.graph.frames.append(number), flight.graph.calls.append(([one.inliers for one in edges], jumped))
    ))  # fmt: skip
    for number in range(len(values)):
        if number in coasts:
            flight.pipeline.move([], SimpleNamespace(mean=np.zeros(6), sigma=np.ones(2)), 0.1)  # type: ignore[arg-type]
        flight.see(float(number))
    return [call for call in flight.graph.calls if isinstance(call[0], list)][1:], flight.pipeline


def test_a_frame_that_is_off_is_refused_and_two_in_a_row_are_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    found, pipeline = trusted(monkeypatch, [[5.0, 9.0], [4.9], [9.0], [5.0]])
    assert found == [([5.0], False), ([4.9], False), ([], False), ([5.0], False)]
    assert pipeline._bias_jumps is not None
    found, pipeline = trusted(monkeypatch, [[9.0], [1.0, 9.0], [8.0], [7.0], [6.0], [6.0], [1.0]])
    assert found == [
        ([], False), ([1.0, 9.0], True), ([8.0], False), ([7.0], False), ([], False), ([6.0], True), ([1.0], False),
    ]  # fmt: skip
    assert pipeline._bias_jumps is None
    pipeline.move([], SimpleNamespace(mean=np.zeros(6)), 0.1)  # type: ignore[arg-type]


def test_frames_without_edges_and_after_a_silence_are_taken_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    found, _ = trusted(monkeypatch, [[9.0], [9.0], [9.0]], coasts=(2, 4))
    assert found == [([9.0], False), ([], False), ([9.0], False)]
    # Each of them lets the frames after a jump pass by: a third frame after it is refused again.
    found, _ = trusted(monkeypatch, [[9.0], [9.0], [], [9.0], [9.0]])
    assert [one for one, _ in found] == [[], [9.0], [], [9.0], []]


def test_a_history_holds_frames_since_the_change_from_the_first_that_is_reached() -> None:
    flight = Flight()
    flight.graph.unreached = (0, 1, 4)
    pipeline = flight.see(*np.arange(9.0))
    history = pipeline.history()
    np.testing.assert_array_equal(history.times, np.arange(2.0, 9.0))
    known = motion()
    for k, time in enumerate(history.times):
        np.testing.assert_allclose(to_matrix(history.chaser[k]), chaser(time)[:3, :3], atol=1e-12)
        if time == 4.0:
            assert np.isnan(history.glued[k]).all()
        else:
            np.testing.assert_allclose(to_matrix(history.glued[k]), relative(time, known)[:3, :3], atol=1e-12)
    assert history.second.tolist() == list(range(7))
    pipeline._since = 5.0
    np.testing.assert_array_equal(pipeline.history().times, [5.0, 6.0, 7.0, 8.0])
    begun = Flight(lambda number: [edge(number)]).see(0.0, 1.0, 2.0)
    assert begun.history().second.tolist() == [0, 1, 2]
    long = Flight().see(0.0, 1.9, 2.0, 241.0, 242.0)
    np.testing.assert_array_equal(long.history().times, [2.0, 241.0, 242.0])


def test_a_motion_is_fitted_every_five_seconds_from_fifteen_on() -> None:
    flight = Flight(lambda number: [edge(number)] if number and number != 25 else [])
    flight.see(*np.arange(15.0))
    assert not flight.fits
    flight.found = lambda *given: motion(misfit=1.7, recent_misfit=1.7, aligned=True)
    flight.see(15.0)
    ((history, known, before, model),) = flight.fits
    np.testing.assert_array_equal(history.times, np.arange(16.0))
    assert (known, before) == (KnownBody(), None)
    np.testing.assert_allclose(to_matrix(model), T_GM[:3, :3], atol=1e-12)
    assert flight.pipeline.target is not None
    flight.see(16.0, 17.0, 18.0, 19.0)
    assert len(flight.fits) == 1
    flight.see(20.0)
    before = flight.fits[1][2]
    expected = motion_of(motion())
    assert before is not None
    assert before.time == expected.time
    np.testing.assert_array_equal(before.orientation, expected.orientation)
    flight.see(21.0, 22.0, 23.0, 24.0, 25.0)
    assert len(flight.fits) == 2  # the frame has no edges
    flight.see(26.0)
    assert len(flight.fits) == 3
    # A motion that fits badly, or whose axes have other directions, is no start for the next.
    flight.pipeline.target = motion(misfit=1.9)
    flight.see(*np.arange(27.0, 32.0))
    assert flight.fits[3][2] is None
    flight.pipeline.target = motion(aligned=False)
    flight.see(*np.arange(32.0, 37.0))
    assert flight.fits[4][2] is None
    flight.graph.model = None
    flight.pipeline.target = motion(aligned=False)
    flight.see(*np.arange(37.0, 42.0))
    assert flight.fits[5][2] is not None
    assert flight.fits[5][3] is None


@pytest.mark.parametrize(
    ("axes", "ratios", "is_start"), [(0.1, (0.3, 0.8), True), (0.3, (0.3, 0.8), False), (0.1, (0.01, 1.0), False)]
)
def test_a_motion_of_an_unknown_body_is_a_start_if_its_axes_are_known_and_it_is_no_rod(
    axes: float, ratios: tuple[float, float], is_start: bool
) -> None:
    for known in (None, shape(1.0)):
        flight = Flight(target=known)
        flight.see(*np.arange(15.0))
        flight.graph.model = None
        flight.pipeline.target = motion(aligned=False, axes_sigma=axes, ratios=np.array(ratios))
        flight.see(15.0)
        assert (flight.fits[-1][2] is not None) == (is_start or known is not None)


def test_frames_that_are_registered_again_are_fitted_at_their_end_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    flight = Flight()
    flight.see(0.0)
    run: Any = SimpleNamespace(pipeline=flight.pipeline)
    run.tolerate = lambda factor: PipelineEstimatorRun.tolerate(run, factor)

    def update(readings: Any) -> Any:
        flight.see(readings.time)
        return SimpleNamespace(updated=0.0)

    run.update = update
    kept: Any = [SimpleNamespace(time=float(second)) for second in range(1, 41)]
    monkeypatch.setattr(flight.pipeline, "_check_motion", lambda *given: None)
    PipelineEstimatorRun.replay(run, kept, np.inf)
    assert [given[0].times[-1] for given in flight.fits] == [30.0, 35.0, 40.0]
    assert flight.pipeline.tolerance == np.inf
    assert PipelineEstimatorRun.replay(run, kept, 10.0) is None


def fitted(
    known: TargetEstimate | None, changed: bool, found: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> Any:
    """Return a pipeline after a fit at 40 s, and what it was asked to forget."""
    flight, forgotten = Flight(target=shape(1.0)), list[Any]()
    flight.see(*np.arange(0.0, 5.0), 25.0, 39.0)
    pipeline = flight.pipeline
    monkeypatch.setattr(pipeline, "_forget_before", lambda *given: forgotten.append(given))
    pipeline.target, pipeline.changed, flight.found = known, changed, found
    flight.fits.clear()
    pipeline._fit(40.0)
    return pipeline, flight.fits, forgotten


def test_what_a_fit_finds_is_believed_as_far_as_it_agrees(monkeypatch: pytest.MonkeyPatch) -> None:
    good, known = motion(time=40.0), motion()
    bad, worse = motion(misfit=2.0), motion(misfit=2.0, recent_misfit=3.5)
    for changed in (False, True):
        pipeline, fits, _ = fitted(known, changed, lambda *given: good, monkeypatch)
        assert (pipeline.target, pipeline.changed, len(fits)) == (good, False, 1)
    pipeline, fits, _ = fitted(known, False, lambda *given: None, monkeypatch)
    assert (pipeline.target, pipeline.changed, len(fits)) == (known, False, 1)
    pipeline, fits, _ = fitted(known, True, lambda *given: None, monkeypatch)
    assert (pipeline.target, pipeline.changed, [given[2] is None for given in fits]) == (known, True, [False, True])
    pipeline, fits, _ = fitted(known, True, lambda *given: good if given[2] is None else bad, monkeypatch)
    assert (pipeline.target, pipeline.changed, len(fits)) == (good, False, 2)
    first, second = fits
    assert first[2].time == known.time
    assert second == (first[0], pipeline._known, None, first[3])
    np.testing.assert_array_equal(pipeline._known.ratios, [0.5, 0.8])
    pipeline, _, forgotten = fitted(known, True, lambda *given: bad, monkeypatch)
    assert (pipeline.target, pipeline.changed, pipeline._since, forgotten) == (known, True, 35.0, [])
    pipeline, _, forgotten = fitted(known, False, lambda *given: bad, monkeypatch)
    assert (pipeline.target, forgotten, pipeline._since) == (bad, [], 0.0)
    pipeline, _, forgotten = fitted(known, False, lambda *given: worse, monkeypatch)
    assert (pipeline.target, forgotten) == (known, [(37.0, 40.0)])
    pipeline, _, forgotten = fitted(None, False, lambda *given: worse, monkeypatch)
    assert (pipeline.target, forgotten) == (worse, [])


def test_a_motion_is_found_from_two_frames_and_some_time_at_least() -> None:
    flight = Flight()
    pipeline = flight.see(*np.arange(0.0, 5.0), 25.0, 39.0)
    flight.fits.clear()
    for since in (25.1, 30.0):  # too short ago, and with a single frame since then
        pipeline._since = since
        pipeline._fit(40.0)
        pipeline._fit(60.0)
    assert not flight.fits
    pipeline._since = 25.0
    pipeline._fit(39.9)
    assert not flight.fits
    pipeline._fit(40.0)
    assert len(flight.fits) == 1
    pipeline._fit(40.0)
    assert len(flight.fits) == 2
    known = pipeline.target = motion()
    pipeline._forget_before(30.0, 39.0)
    assert (pipeline.target, pipeline.changed, pipeline._since) == (known, True, 30.0)
    pipeline._forget_before(25.0, 39.0)
    assert pipeline.target is not known
    assert pipeline.target.time == 39.0


@pytest.mark.parametrize(("aligned", "model", "seen"), [(True, True, True), (False, True, False), (False, False, True)])
def test_the_newest_attitudes_are_those_of_the_frames_that_are_reached(
    aligned: bool, model: bool, seen: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight = Flight()
    flight.graph.model = T_GM if model else None
    flight.graph.unreached = (8,)
    pipeline, checks = flight.see(*np.arange(11.0)), list[Any]()
    monkeypatch.setattr(module, "departs", lambda *given: checks.append(given) or False)
    pipeline.target = known = motion(aligned=aligned)
    pipeline._check_motion(10.0, [edge(10)])
    assert len(checks) == seen
    for _, times, found, *_ in checks:
        np.testing.assert_array_equal(times, [6.0, 7.0, 9.0, 10.0])
        wanted = known.predict(times)[0]
        np.testing.assert_allclose(np.abs((found * wanted).sum(axis=1)), np.ones(4), atol=1e-12)


def test_a_change_lets_the_newest_frames_say_how_the_target_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    flight = Flight()
    pipeline = flight.see(*np.arange(10.0))
    true = motion()
    other = replace(true, orientation=exp(np.array([0.2, 0.0, 0.1])), angular_velocity=np.zeros(3))
    checks: list[Any] = []
    monkeypatch.setattr(module, "departs", lambda *given: checks.append(given) or False)
    pipeline.target = other
    pipeline._check_motion(9.0, [])
    assert not checks
    pipeline._check_motion(9.0, [edge(9), edge(9)])
    ((known, times, _, sigma, tolerance),) = checks
    assert tolerance == 1.0
    assert known is other
    assert sigma == pytest.approx(1e-2)
    np.testing.assert_array_equal(times, np.arange(5.0, 10.0))
    assert (pipeline.target, pipeline.changed) == (other, False)
    monkeypatch.setattr(module, "departs", lambda *given: True)
    pipeline._check_motion(9.0, [edge(9)])
    assert (pipeline.changed, pipeline._since) == (True, 7.0)  # the third newest frame
    found: TargetEstimate = pipeline.target
    q, _ = true.predict(np.array([7.0, 9.0]))
    assert found.time == 9.0
    assert abs(found.orientation @ q[1]) == pytest.approx(1.0)
    turn = rotation_log(to_matrix(q[0]).T @ to_matrix(q[1])) / 2.0
    np.testing.assert_allclose(found.angular_velocity, turn, atol=1e-12)
    sigmas = [0.05] * 3 + [0.02] * 3 + [np.sqrt(7.0 + 8.0)] * 2
    np.testing.assert_allclose(found.covariance, np.diag(np.square(sigmas)), atol=1e-15)
    assert (found.ratios is other.ratios, found.q_GT is other.q_GT) == (True, True)
    # While it is changed, the newest three seconds are followed.
    flight.see(10.0, 11.0, 12.0)
    q, _ = true.predict(np.array([9.0, 12.0]))
    np.testing.assert_allclose(
        pipeline.target.angular_velocity, rotation_log(to_matrix(q[0]).T @ to_matrix(q[1])) / 3.0, atol=1e-12
    )
    # Of a single new frame far from the others, the two newest.
    flight.see(20.0)
    q, _ = true.predict(np.array([12.0, 13.0]))
    turn = rotation_log(to_matrix(q[0]).T @ to_matrix(q[1])) / 8.0
    np.testing.assert_allclose(pipeline.target.angular_velocity, turn, atol=1e-12)
    assert pipeline.target.time == 20.0


def test_a_frame_tells_of_the_target_where_an_edge_reaches_it() -> None:
    flight = Flight(lambda number: [edge(number)] if number in (1, 4, 5) else [])
    flight.graph.unreached = (4,)
    updated = []
    for time in range(6):
        updated.append(flight.see(float(time)).updated)
    assert updated == [0.0, 1.0, 1.0, 1.0, 1.0, 5.0]
    assert flight.pipeline.graph is not None
    assert flight.pipeline.graph.frame == 5
