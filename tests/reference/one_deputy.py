"""A small simulation of one deputy that inspects the chief.

The matrix exponential is SciPy's and K-means scikit-learn's; the rest is NumPy. Nothing of the package is used, not
even its configuration files: the numbers of `SHIPPED` and `SEED` are those that docs/simulation.md states, and the
numbers of `PEER` those of docs/parity.md. SI units, Hill's frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import expm
from sklearn.cluster import KMeans

N, MASS, DT, RADIUS = 0.001027, 12.0, 10.0, 10.0
PER_CLUSTER = 10
TERMS = ("ObservedPointsReward", "InspectionSuccessReward", "InspectionCrashReward", "InspectionDeltaVReward")


@dataclass(frozen=True)
class Task:
    """The numbers in which the tasks differ."""

    success: float = 1.0
    thrust: float = 1.0  # largest on each axis [N]
    price: tuple[float, float] = (-0.001, -0.1)  # scale of the delta-v reward: where it starts, and its far bound
    price_change: float = -5e-5
    price_interval: int = 1500
    points: str = "fibonacci"
    num_points: int = 100
    near: float = 10.0
    far: float = 800.0
    horizon: int = 1224
    ray_offset: float = 0.0
    sees_sun_direction: bool = False  # the direction to the sun is observed, not its angle
    scales: tuple[float, float, float] = (100.0, 0.5, 100.0)  # of observed positions, velocities and counts
    wraps_sun: bool = True


SHIPPED = Task(3.0, 0.1, (-0.02, -0.8), -0.01, 250, sees_sun_direction=True)
SEED = Task()
PEER = Task(
    price=(-0.001, -0.001), points="cmu", near=15.0, ray_offset=1e-5, scales=(1.0, 1.0, 1.0), wraps_sun=False
)  # fmt: skip


def fibonacci(count: int) -> np.ndarray:
    """Return points of the unit sphere on a golden-angle spiral, in slices of equal height from +z to -z."""
    height = (np.arange(count, 0, -1) - 0.5) / count * 2.0 - 1.0
    turn = 2.0 * math.pi * (1.0 - 2.0 / (1.0 + math.sqrt(5.0)))
    across = np.exp(1j * turn * np.arange(count)) * np.sin(np.arccos(height))
    return np.column_stack((across.real, across.imag, height))


def rings(*sizes: int) -> np.ndarray:
    """Return points of the unit sphere in rings at equal steps of the polar angle, from +z to -z."""
    polar = (np.arange(len(sizes)) + 0.5) * math.pi / len(sizes)
    return np.array(
        [
            (math.sin(t) * math.cos(a), math.sin(t) * math.sin(a), math.cos(t))
            for t, size in zip(polar, sizes, strict=True)
            for a in 2.0 * math.pi * np.arange(size) / size
        ]
    )


def hold(duration: float, n: float = N, mass: float = MASS) -> np.ndarray:
    """Return the map of (position, velocity, thrust) over a held thrust, by one matrix exponential, shape (6, 9)."""
    rates = np.zeros((9, 9))
    rates[0:3, 3:6] = np.eye(3)
    rates[3, 0], rates[3, 4], rates[4, 3], rates[5, 2] = 3.0 * n * n, 2.0 * n, -2.0 * n, -n * n
    rates[3:6, 6:9] = np.eye(3) / mass
    return np.asarray(expm(rates * duration)[:6])


def sun_direction(angle: float) -> np.ndarray:
    """Return the unit vector to the sun: it turns clockwise about +z."""
    return np.array([math.cos(angle), -math.sin(angle), 0.0])


def seen(points: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Return which points are above the horizon: the line of sight leaves the sphere outwards."""
    return np.einsum("pk,pk->p", position - points, points) >= 0.0


def lit(points: np.ndarray, sun: np.ndarray, offset: float) -> np.ndarray:
    """Return which points have a free ray to the sun, which starts `offset` above the sphere.

    |o + t s| = R has roots t > 0 when o.s < 0 and (o.s)^2 >= |o|^2 - R^2.
    """
    along = points @ sun * (1.0 + offset / RADIUS)
    gap = (RADIUS + offset) ** 2 - RADIUS**2
    return ~((along <= 0.0) & (along**2 >= gap)) if offset else along > 0.0


class Clusters:
    """The direction to the nearest cluster of points, by scikit-learn's K-means from the centres of the step before."""

    def __init__(self, key: int) -> None:
        self._key, self._centres, self._settled = key, np.zeros((0, 3)), np.zeros((0, 3))

    def direction(self, step: int, candidates: np.ndarray, position: np.ndarray) -> np.ndarray:
        """Return the unit vector to the centre nearest to a position; zeros without candidates."""
        want = -(-len(candidates) // PER_CLUSTER)
        kept = self._centres[:want]
        self._centres = np.concatenate((kept, candidates[list(self._picks(step, len(candidates), want - len(kept)))]))
        if not want:
            return np.zeros(3)
        if not np.array_equal(candidates, self._settled):  # else the centres are where the means are
            means = KMeans(want, init=self._centres, n_init=1, max_iter=50, tol=0.0).fit(candidates)
            self._centres = means.cluster_centers_
            self._settled = candidates if means.n_iter_ < 50 else np.zeros((0, 3))
        nearest = self._centres[np.argmin(np.linalg.norm(self._centres - position, axis=1))]
        return nearest / np.linalg.norm(nearest)

    def _picks(self, step: int, below: int, count: int) -> Iterator[int]:
        """Yield distinct numbers: a Fisher-Yates shuffle that SplitMix64 draws from key, step and place."""
        deck = list(range(below))
        for place in range(count):
            word = _mix(_mix(self._key + _WEYL * (step + 1)) + _WEYL * (place + 1))
            other = place + word % (below - place)
            deck[place], deck[other] = deck[other], deck[place]
            yield deck[place]


_WEYL, _WORD = 0x9E3779B97F4A7C15, (1 << 64) - 1


def _mix(word: int) -> int:
    """Return the output function of SplitMix64, in whole numbers of Python."""
    word &= _WORD
    word = (word ^ (word >> 30)) * 0xBF58476D1CE4E5B9 & _WORD
    word = (word ^ (word >> 27)) * 0x94D049BB133111EB & _WORD
    return word ^ (word >> 31)


@dataclass
class Flight:
    """Raw values of one episode of T steps: those of states have T + 1 rows, those of steps T."""

    position: list[np.ndarray] = field(default_factory=list)
    velocity: list[np.ndarray] = field(default_factory=list)
    sun_angle: list[float] = field(default_factory=list)
    inspected: list[np.ndarray] = field(default_factory=list)
    delta_v: list[float] = field(default_factory=list)
    observation: list[np.ndarray] = field(default_factory=list)
    terms: list[dict[str, float]] = field(default_factory=list)
    status: str = "running"
    truncated: bool = False

    @property
    def steps(self) -> int:
        """Number of steps so far."""
        return len(self.terms)

    @property
    def count(self) -> int:
        """Number of inspected points."""
        return int(self.inspected[-1].sum())


class OneDeputy:
    """One environment slot: episodes follow one another, and the price of fuel lives through them.

    Args:
        task: Its numbers.
        observes: Whether observations are made, which take most of the time.
    """

    def __init__(self, task: Task, *, observes: bool = True) -> None:
        sphere = rings(3, 9, 13, 16, 17, 16, 13, 9, 3) if task.points == "cmu" else fibonacci(task.num_points)
        self.task, self.points, self.price = task, RADIUS * sphere, task.price[0]
        self._map, self._observes = hold(DT), observes
        self._steps, self._fractions = 0, list[float]()

    def reset(self, position: np.ndarray, velocity: np.ndarray, sun_angle: float, key: int = 0) -> Flight:
        """Begin an episode; `key` starts the draws of its clusters."""
        self.flight = Flight()
        self._clusters = Clusters(key)
        self._keep(np.array(position, float), np.array(velocity, float), sun_angle, 0.0)
        return self.flight

    def step(self, thrust: np.ndarray) -> Flight:
        """Hold a thrust over one step; what is beyond the largest is cut off."""
        flight, task = self.flight, self.task
        thrust = np.clip(np.asarray(thrust, float), -task.thrust, task.thrust)
        state = self._map @ np.concatenate((flight.position[-1], flight.velocity[-1], thrust))
        spent = np.abs(thrust).sum() * DT / MASS
        before = flight.count if flight.steps else 0
        self._keep(state[:3], state[3:], flight.sun_angle[-1] + N * DT, flight.delta_v[-1] + spent)
        distance, count = math.hypot(*state[:3]), flight.count
        complete = count == len(self.points)
        worth = (0.01 * (count - before), task.success * complete, -1.0 * (distance < task.near), self.price * spent)
        flight.terms.append(dict(zip(TERMS, map(float, worth), strict=True)))
        if distance < task.near or distance > task.far:
            flight.status = "lose"
        elif complete:
            flight.status = "win"
        elif flight.steps == task.horizon:
            flight.status, flight.truncated = "draw", True
        self._follow_price()
        return flight

    def _follow_price(self) -> None:
        """Move the price once the interval is over; an episode that ends with that step counts in the next one."""
        flight, (first, last) = self.flight, self.task.price
        self._steps += 1
        if self._steps == self.task.price_interval:
            mean = np.mean(self._fractions) if self._fractions else 0.85
            change = self.task.price_change * ((mean >= 0.9) - int(mean <= 0.8))
            self.price = min(max(self.price + change, last), first)
            self._steps, self._fractions = 0, []
        if flight.status != "running":
            self._fractions.append(flight.count / len(self.points))

    def _keep(self, position: np.ndarray, velocity: np.ndarray, sun_angle: float, delta_v: float) -> None:
        """Add a state: look at the points, then observe."""
        flight, sun, task = self.flight, sun_direction(sun_angle), self.task
        bright = lit(self.points, sun, task.ray_offset)
        before = flight.inspected[-1] if flight.inspected else np.zeros(len(self.points), bool)
        flight.inspected.append(before | (seen(self.points, position) & bright))
        flight.position.append(position)
        flight.velocity.append(velocity)
        flight.sun_angle.append(sun_angle)
        flight.delta_v.append(delta_v)
        if not self._observes:
            return
        left = self.points[bright & ~flight.inspected[-1]]
        direction = self._clusters.direction(len(flight.position) - 1, left, position)
        far, fast, many = task.scales
        angle = [sun_angle % (2.0 * math.pi) if task.wraps_sun else sun_angle]
        last = sun if task.sees_sun_direction else angle
        parts = (position / far, velocity / fast, [flight.count / many], direction, last)
        flight.observation.append(np.concatenate(parts))


def fly(deputy: OneDeputy, control: Callable[[Flight], np.ndarray]) -> Flight:
    """Continue an episode until it ends."""
    while deputy.flight.status == "running":
        deputy.step(control(deputy.flight))
    return deputy.flight


@dataclass(frozen=True)
class Ellipse:
    """A scripted controller: it steers onto a closed relative orbit and follows it with whole burns.

    In the orbital plane the ellipse is twice as long as it is high, and the deputy turns on it as the sun does; across
    the plane it swings three times as fast. Where a burn would be more than twice too much it coasts.

    Attributes:
        burn: Burn on each axis [N].
        high: Half the height of the ellipse [m].
        wide: Amplitude across the plane [m].
        phase: Phase of the ellipse at the start [rad].
        lead: Phase of the swing [rad].
    """

    burn: float
    high: float = 40.0
    wide: float = 40.0
    phase: float = 0.0
    lead: float = 0.0

    def __call__(self, flight: Flight) -> np.ndarray:
        """Return the thrust [N]."""
        now = N * DT * flight.steps
        a, b = now + self.phase, 3.0 * now + self.lead
        where = np.array([self.high * math.sin(a), 2.0 * self.high * math.cos(a), self.wide * math.sin(b)])
        speed = N * np.array([self.high * math.cos(a), -2.0 * self.high * math.sin(a), 3.0 * self.wide * math.cos(b)])
        want = speed + 0.004 * (where - flight.position[-1]) - flight.velocity[-1]
        return self.burn * np.clip(np.rint(want * MASS / DT / self.burn), -1.0, 1.0)
