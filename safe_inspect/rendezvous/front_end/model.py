"""Front end for a known shape, whose errors do not accumulate over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from safe_inspect.errors import ConfigError
from safe_inspect.rendezvous.depth_camera import DepthCamera, DepthFrame
from safe_inspect.rendezvous.front_end.base import FrontEnd, FrontEndContext, Registration, RelativeMotion, relative
from safe_inspect.rendezvous.front_end.cleaning import Cleaning, Cloud
from safe_inspect.rendezvous.front_end.model_registration import (
    LARGEST_DISTANCE,
    ModelRegistration,
    acquire,
    distinct_poses,
)
from safe_inspect.rendezvous.front_end.placing import Placing
from safe_inspect.rendezvous.poses import MODEL, Edge, adjoint, difference, inverse, perturbed, rotation_log
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import FloatArray
from safe_inspect.units import NonNegativeLength, PositiveLength

#: Frames with fewer points are not used, and not searched without a prediction.
_LEAST_POINTS, _SEARCH_POINTS = 150, 300
#: Number of points of a frame that are registered; more do not add to the accuracy.
_USED_POINTS = 1500
#: Minimum fraction of the points close to the shape, and maximum mean distance [m], of an accepted frame.
_LEAST_INLIERS, _LARGEST_SCORE = 0.6, 0.01
#: Minimum fraction on a map, which may lack much of what a frame shows.
_LEAST_MAPPED = 0.3
#: Range at which cameras are compared [m], and the standard deviation there for which the limits of distances hold [m].
TYPICAL_RANGE = 1.5
_TYPICAL_NOISE = 3e-3 + 1.5e-3 * TYPICAL_RANGE**2
#: Maximum difference of an accepted pose of the chaser from the prediction [rad, m], while the motion is not known yet
#: of the shape: a target that turns moves the chaser in M.
_LARGEST_OFF = (np.deg2rad(25.0), 0.25)
#: Standard deviations of the prediction of this front end and of that of the back end [rad, m].
_PREDICTION, _EXPECTATION = (np.deg2rad(2.0), 0.02), (np.deg2rad(0.5), 0.005)
#: The same of a pose that is known from elsewhere.
_KNOWN = np.deg2rad(1.0), 0.05
#: Standard deviations of an unknown angular velocity [rad/s] and velocity [m/s] of the target.
_UNKNOWN_MOTION = (np.deg2rad(8.0), 0.03)
#: Number of consecutive frames without a pose after which a hypothesis is dropped; without any left, the shape is
#: searched again.
_FAILURES = 3
#: Number of possible poses above which a frame is too ambiguous to start with; a cube has 24.
_ALTERNATIVES = 24
#: Time after a frame that was too ambiguous until the next search [s]; the view has hardly changed before.
_SEARCH_PERIOD = 3.0
#: Difference of attitude within which a found pose is the expected one [rad].
_EXPECTED_TURN = np.deg2rad(45.0)
#: Poses whose scores exceed the best one by at most this much may be right too [m].
_AMBIGUITY = 0.004
#: Sum of the differences of scores over at least two distinct views that rules a pose out at once [m]; number of views
#: from which a sixth of this sum suffices if the mean difference is more than four times its standard error; and the
#: angle between two distinct views [rad].
_MARGIN, _VIEWS, _VIEW_ANGLE = 0.003, 15, np.deg2rad(10.0)
#: Ratio of a frame's best score to the mean over that pose's views above which the frame does not decide between poses:
#: of a plate seen from its edge, for instance, most pixels are flying ones.
_UNCLEAR = 1.5
#: Standard deviation of the errors of a map's normals along each axis [rad].
_ROUGHNESS = 0.1
#: Weight of a frame in the update of the pose of G in M, and the difference [rad, m] beyond which the pose is replaced.
_PLACING, _FAR_OFF = 0.2, (0.1, 0.1)


def _is_beyond(off: FloatArray, limits: tuple[float, float]) -> bool:
    """Return whether a tangent's rotation [rad] or translation [m] is longer than a limit."""
    return bool(np.linalg.norm(off[:3]) > limits[0] or np.linalg.norm(off[3:]) > limits[1])


@dataclass(eq=False)
class _Hypothesis:
    """A hypothesis of the target's pose, which is followed over several frames.

    Attributes:
        found: The newest registration of the target's shape.
        first: The registration in the first frame of the search.
        first_number: Number of that frame.
        motion: Predictor of the target's motion under this hypothesis.
        view: Attitude R_MB at the newest distinct view, shape (3, 3); None before the first one.
        failures: Number of consecutive frames in which the hypothesis did not match.
        score: Score in the newest frame [m].
        scores: Scores at the distinct views [m].
    """

    found: Registration
    first: Registration
    first_number: int
    motion: RelativeMotion
    view: FloatArray | None = None
    failures: int = 0
    score: float = 0.0
    scores: list[float] = field(default_factory=list)

    @property
    def total(self) -> float:
        """Sum of the scores [m]."""
        return sum(self.scores)

    @property
    def sees_new_view(self) -> bool:
        """Whether the view differs from the newest distinct one."""
        seen = self.found.pose[:3, :3]
        return self.view is None or bool(np.linalg.norm(rotation_log(self.view.T @ seen)) >= _VIEW_ANGLE)


class ModelFrontEnd(FrontEnd):
    """Front end that registers each frame to the known shape of the target; its errors do not accumulate over time.

    Points are fitted to the surface that looks to the camera, and the shape to the frame's silhouette. The first pose
    is found by a search over all attitudes. If the shape looks the same from several attitudes, further views decide
    between them.

    Attributes:
        range_sigma: Constant part of the standard deviation of a measured range [m].
        range_growth: Part at a range of 1 m that grows with the square of the range [m].
    """

    range_sigma: PositiveLength = 3e-3  # type: ignore[valid-type]
    range_growth: NonNegativeLength = 1.5e-3  # type: ignore[valid-type]

    def __call__(self, context: FrontEndContext) -> ModelFrontEndRun:
        """Return the front end for a mission.

        Raises:
            ConfigError: The target's shape is not known.
        """
        if context.target is None:
            raise ConfigError("ModelFrontEnd needs the shape of the target; give a target, or use GicpSubmapFrontEnd")
        roughness = _ROUGHNESS if context.poses else 0.0
        registration = self.registration(context.target, context.camera, context.T_BC, roughness)
        # Do not drop pixels at depth edges: the cut rejects flying pixels, and a thin part has no other pixels.
        cleaning = Cleaning(context.camera, edge=np.inf)
        return ModelFrontEndRun(cleaning, registration, context.T_BC, self._noise_ratio * _LARGEST_SCORE, context.poses)

    @property
    def range_noise(self) -> float:
        """Standard deviation of a measured range of 1.5 m that the front end assumes [m]."""
        return float(self.range_sigma + self.range_growth * TYPICAL_RANGE**2)

    @property
    def _noise_ratio(self) -> float:
        """Ratio of the noise to that for which the limits of distances hold; 1 for less noise."""
        return max(self.range_noise / _TYPICAL_NOISE, 1.0)

    def registration(
        self,
        target: Target,
        camera: DepthCamera,
        T_BC: FloatArray,  # noqa: N803
        roughness: float = 0.0,
    ) -> ModelRegistration:
        """Return the registration of frames to a known target.

        Args:
            target: The target.
            camera: Geometry of the camera.
            T_BC: Pose of the camera in B, shape (4, 4).
            roughness: Standard deviation of the errors of the shape's normals [rad].
        """
        cut = self._noise_ratio * LARGEST_DISTANCE
        return ModelRegistration(target, camera, T_BC, self.range_sigma, self.range_growth, cut, roughness)


class ModelFrontEndRun:
    """Front end of one mission; it registers every frame to the known shape.

    At first, all poses that look alike are tracked. While more than one remains, the pose relative to the first frame
    of the search is returned: all of them give the same relative motion, without drift. Afterwards, poses relative to
    the model are returned. If tracking is lost, a search follows in which poses close to the back end's prediction are
    preferred.

    Args:
        cleaning: Cleans frames.
        registration: Registers frames.
        T_BC: Pose of the camera in B, shape (4, 4).
        largest_score: Largest score of an accepted registration [m].
        poses: T_MB of the first frames as known from elsewhere, by their number, shape (4, 4) each; empty for none. A
            shape with known poses is a map of what was seen: frames may show parts that are not on it, so that a score
            decides nothing, and a pose that differs much from the expected one is wrong.

    Attributes:
        placing: Where the frames together show a map.
    """

    def __init__(
        self,
        cleaning: Cleaning,
        registration: ModelRegistration,
        T_BC: FloatArray,  # noqa: N803
        largest_score: float,
        poses: Mapping[int, FloatArray],
    ) -> None:
        self._cleaning, self._registration, self._T_BC = cleaning, registration, T_BC
        self._largest_score, self._poses = np.inf if poses else largest_score, poses
        self._least_inliers = _LEAST_MAPPED if poses else _LEAST_INLIERS
        self._hypotheses: list[_Hypothesis] = []
        self._count = 0
        self._search_again = -np.inf
        self._T_MG: FloatArray | None = None
        self.placing = Placing()

    def step(self, frame: DepthFrame, predicted: FloatArray | None, rotation: FloatArray) -> list[Edge]:
        """Return the pose relative to the model; while it is ambiguous, that relative to the search's first frame."""
        number = self._count
        self._count += 1
        for hypothesis in self._hypotheses:
            hypothesis.motion.turned(rotation)
        cloud = self._cleaning(frame, self._T_BC)
        if len(cloud) < _LEAST_POINTS:
            self._fail(self._hypotheses)
            return []
        cloud = cloud.thinned(_USED_POINTS)
        expected = None if predicted is None else self._expected(predicted)
        was_ambiguous = len(self._hypotheses) > 1
        if number in self._poses:
            self._place_known(cloud, frame.time, self._poses[number])
        elif self._hypotheses:
            self._track(cloud, frame.time, expected if len(self._hypotheses) == 1 else None)
        elif len(cloud) >= _SEARCH_POINTS and frame.time >= self._search_again:
            self._search(cloud, frame.time, expected)
        if not self._hypotheses or self._hypotheses[0].failures:
            return []
        if self._is_clear:
            self._choose()
        best = self._hypotheses[0]
        edges = []
        if was_ambiguous and best.first_number < number:
            edges.append(self._since_first(best, number))
        if len(self._hypotheses) == 1:
            found = best.found
            edges.append(Edge(MODEL, number, found.pose, found.covariance(), found.inliers, "model"))
            if predicted is not None:
                self._place(found, predicted, frame.time)
        return edges

    @property
    def _is_clear(self) -> bool:
        """Whether the frame may decide between hypotheses: the one that fits best fits about as well as before."""
        best = min((one for one in self._hypotheses if not one.failures), key=lambda one: one.score, default=None)
        return best is not None and (not best.scores or best.score <= _UNCLEAR * best.total / len(best.scores))

    def _fail(self, failed: list[_Hypothesis]) -> None:
        """Count a frame in which hypotheses did not match, and drop those that have failed too often in a row.

        A frame that does not decide drops none, or all if the motion of one of them is not known: that one is lost, and
        may be the right one.
        """
        for hypothesis in failed:
            hypothesis.failures += 1
        lost = [one for one in self._hypotheses if one.failures >= _FAILURES]
        if len(lost) == len(self._hypotheses) or self._is_clear:
            self._hypotheses = [one for one in self._hypotheses if one.failures < _FAILURES]
        elif not all(one.motion.is_known for one in lost):
            self._hypotheses = []

    def _expected(self, predicted: FloatArray) -> FloatArray | None:
        """Return T_MB for a predicted T_GB, shape (4, 4); None before the pose of G in M is known."""
        if self._poses:
            return self.placing.expected(predicted)
        return None if self._T_MG is None else self._T_MG @ predicted

    def _place(self, found: Registration, predicted: FloatArray, time: float) -> None:
        """Update the pose of G in M with a fraction of a frame's correction; replace it if the correction is large."""
        if self._poses:
            self.placing.update(time, predicted, found.pose, found.covariance())
            return
        shown = found.pose @ inverse(predicted)
        if self._T_MG is None or _is_beyond(off := difference(self._T_MG, shown), _FAR_OFF):
            self._T_MG = shown
        else:
            self._T_MG = perturbed(self._T_MG, _PLACING * off)

    def _registered(
        self, cloud: Cloud, motion: RelativeMotion, time: float, expected: FloatArray | None
    ) -> tuple[FloatArray, Registration]:
        """Return the predicted pose, and the registration that starts from it or from the back end's prediction.

        The back end's prediction constrains directions that the frame does not, for instance along a face that fills
        the image, where the prediction of the front end would drift. If they differ, the target may move differently
        than the back end assumes. The better fit is returned.
        """
        start = motion.predict(time)
        if not motion.is_known and expected is None:
            # The target may have turned about its centre, which displaces it in B much less than B in M.
            covariance = np.diag(np.repeat(_PREDICTION, 3) ** 2)
            carry, moved = adjoint(inverse(start)), np.array(_UNKNOWN_MOTION) * (time - motion.time)
            covariance += carry @ np.diag(np.repeat(moved, 3) ** 2) @ carry.T
            return start, self._registration(cloud, start, np.linalg.inv(covariance), iterations=25, widening=2.5)
        starts = [] if expected is None else [(expected, _EXPECTATION)]
        if expected is None or _is_beyond(difference(expected, start), _PREDICTION):
            starts.append((start, _PREDICTION))
        tried = [self._registration(cloud, at, np.diag(np.repeat(sigmas, 3) ** -2)) for at, sigmas in starts]
        return start, min(tried, key=lambda one: one.score)

    def _track(self, cloud: Cloud, time: float, expected: FloatArray | None) -> None:
        """Register the frame from the prediction of each hypothesis and, if it is given, from the back end's."""
        failed = []
        for hypothesis in self._hypotheses:
            start, found = self._registered(cloud, hypothesis.motion, time, expected)
            is_known = hypothesis.motion.is_known
            off = difference(start, found.pose) if is_known else difference(inverse(start), inverse(found.pose))
            hypothesis.score = found.score
            fits = found.inliers >= self._least_inliers and found.score <= self._largest_score
            if fits and not _is_beyond(off, _LARGEST_OFF):
                hypothesis.found, hypothesis.failures = found, 0
                hypothesis.motion.observe(time, found.pose)
            else:
                failed.append(hypothesis)
        self._fail(failed)
        self._hypotheses.sort(key=lambda one: (one.failures > 0, one.total + one.score))
        # Between hypotheses that have become the same pose, the views to come would never decide.
        matched = [one.found for one in self._hypotheses if not one.failures]
        apart = {id(found) for found in distinct_poses(matched, len(matched))}
        self._hypotheses = [one for one in self._hypotheses if one.failures or id(one.found) in apart]

    def _place_known(self, cloud: Cloud, time: float, start: FloatArray) -> None:
        """Register a frame from a pose that is known from elsewhere, whatever parts of the shape it does not see."""
        found = self._registration(cloud, start, np.diag(np.repeat(_KNOWN, 3) ** -2), widening=2.0)
        if found.inliers < self._least_inliers:
            self._fail(self._hypotheses)
        elif self._hypotheses:
            self._hypotheses = self._hypotheses[:1]
            hypothesis = self._hypotheses[0]
            hypothesis.found, hypothesis.failures, hypothesis.score = found, 0, found.score
            hypothesis.motion.observe(time, found.pose)
        else:
            self._hypotheses = [self._hypothesis(found, time)]

    def _search(self, cloud: Cloud, time: float, expected: FloatArray | None) -> None:
        """Search for the shape in all attitudes, preferring those close to the back end's prediction, if it is given.

        Do nothing if too many poses explain the frame.
        """
        found = acquire(self._registration, cloud, kept=_ALTERNATIVES + 1)
        fitting = [one for one in found if one.score <= found[0].score + _AMBIGUITY]
        if fitting[0].score > self._largest_score:
            return
        if len(fitting) > _ALTERNATIVES:
            self._search_again = time + _SEARCH_PERIOD - 1e-9
            return
        if expected is not None:
            of = found if self._poses else fitting
            near = [one for one in of if np.linalg.norm(difference(expected, one.pose)[:3]) < _EXPECTED_TURN]
            fitting = near if self._poses else near or fitting
        self._hypotheses = [self._hypothesis(one, time) for one in fitting]

    def _hypothesis(self, found: Registration, time: float) -> _Hypothesis:
        """Return the hypothesis that begins with a registration of the newest frame."""
        return _Hypothesis(found, found, self._count - 1, RelativeMotion(time, found.pose), score=found.score)

    def _choose(self) -> None:
        """Record the scores at each distinct view and drop the hypotheses that are ruled out.

        A frame in which a hypothesis did not match is no view: its score is that of a wrong optimum.
        """
        if any(one.failures for one in self._hypotheses) or not self._hypotheses[0].sees_new_view:
            return
        for one in self._hypotheses:
            one.view = one.found.pose[:3, :3]
            one.scores.append(one.score)
        self._hypotheses.sort(key=lambda one: one.total)
        first = self._hypotheses[0]
        self._hypotheses = [one for one in self._hypotheses if one is first or not self._is_ruled_out(one, first)]

    def _is_ruled_out(self, one: _Hypothesis, best: _Hypothesis) -> bool:
        differences = np.array(one.scores) - np.array(best.scores)
        total, count = float(differences.sum()), len(differences)
        error = float(differences.std()) / np.sqrt(count)
        is_significant = count >= _VIEWS and total > _MARGIN / 6.0 and total / count > 4.0 * error
        return bool(count > 1 and (total > _MARGIN or is_significant))

    def _since_first(self, hypothesis: _Hypothesis, number: int) -> Edge:
        """Return the edge from the first frame of the search, ``T_MB'^-1 T_MB``, with the errors of both poses."""
        between, covariance = relative(hypothesis.first, hypothesis.found)
        kind: Literal["odometry", "skip"] = "odometry" if number == hypothesis.first_number + 1 else "skip"
        return Edge(hypothesis.first_number, number, between, covariance, hypothesis.found.inliers, kind)
