"""Results of the planner, of target models and of simulated sensors on fixed inputs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from safe_inspect.config.data import configs_root
from safe_inspect.geometry.oriented_boxes import OrientedBoxes
from safe_inspect.missions.truth import ChaserTrace, SensorSuite, target_motion
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.estimate import BodyState
from safe_inspect.rendezvous.experiment import load_rendezvous
from safe_inspect.rendezvous.measured_poses import PoseFrame
from safe_inspect.rendezvous.planner.approach import SplineSCPPlanner, _bent_starts, _PlanUnits, _ranked_problems
from safe_inspect.rendezvous.planner.checks import certify, possible_waits, start_problem, terminal_problem
from safe_inspect.rendezvous.planner.paths import SplinePath
from safe_inspect.rendezvous.planner.problem import approach_problem
from safe_inspect.rendezvous.planner.query import Limits, Plan, PlanQuery
from safe_inspect.rendezvous.planner.scp import constraint_rows, within_limits
from safe_inspect.rendezvous.target.boxes import Box, BoxTarget, EnvisatTarget
from safe_inspect.rendezvous.target.mesh import MeshTarget
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.simulators.resets.parameters import Draw, Parameter
from safe_inspect.tasks.docking.tumble_parameter import RandomTumble, TriAxialTumble, tumble_states

from .control import STREAMS, Pieces, query

#: A bus with one long array.
_BOXES = OrientedBoxes(
    np.array([[-0.057, 0.0, 0.0], [0.645, 0.0, 0.0]]),
    np.array([[0.25, 0.069, 0.053], [0.35, 0.125, 0.003]]),
    np.stack((np.eye(3), np.eye(3))),
)
_BEHIND = np.array([0.5, 0.5, -0.5, 0.5])


def _plan(found: Plan) -> Any:
    report, path = found.report, found.path
    assert path is None or isinstance(path, SplinePath)
    return [
        found.status.value,
        report.message,
        report.starts,
        report.cost,
        report.clearance,
        found.t_start,
        found.duration,
        None if path is None else path.points,
    ]


def _queries() -> dict[str, PlanQuery]:
    free = query(solid=_BOXES)
    orbit = replace(free, mean_motion=2e-3, durations=(60.0, 50.0), waits=(0.0, 4.0))
    large = Limits(
        speed=1.2,
        planned_force=40.0,
        force=80.0,
        keep_in=np.full(3, 20.0),
        radius=2.5,
        mass=1000.0,
        line_of_sight_rate=0.1,
        cone_range=7.0,
        least_range=2.0,
    )
    scaled = replace(
        orbit,
        length=10.0,
        limits=large,
        state=np.repeat([10.0, 1.0], 3) * free.state,
        durations=(80.0,),
        solid=OrientedBoxes(10.0 * _BOXES.centre, 10.0 * _BOXES.half_size, _BOXES.rotation),
        mating_point=10.0 * free.mating_point,
        margin=lambda times: np.full(times.shape, 0.8),
        angular_velocity=0.5 * free.angular_velocity,
    )
    return {
        "free": free,
        "behind": replace(free, orientation=_BEHIND, durations=(60.0, 45.0), waits=(0.0, 3.0, 9.0)),
        "cone": replace(free, limits=Limits(cone=0.9), orientation=_BEHIND),
        "orbit": orbit,
        "scaled": scaled,
        "short": replace(free, durations=(12.0,)),
    }


def _plans() -> Any:
    planner = SplineSCPPlanner(control_points=11, samples=31)
    found = {name: _plan(planner(one)) for name, one in _queries().items()}
    several = SplineSCPPlanner(control_points=10, samples=21, multi_start=True)
    return found | {"several starts": _plan(several(query(solid=_BOXES, orientation=_BEHIND)))}


def _parts_of_plans() -> Any:
    found: dict[str, Any] = {}
    for name, one in _queries().items():
        problem = approach_problem(one, one.waits[-1], one.durations[0], 11, 31)
        cold, rows = problem.cold(), constraint_rows(problem, problem.cold())
        nearest = within_limits(problem, cold)
        proof = certify(one, SplinePath(problem.basis, cold), one.waits[-1])
        ranked, reason = _ranked_problems(one, 11, 31)
        units = _PlanUnits.of(one)
        found[name] = [
            problem.cost(cold),
            problem.hessian,
            nearest,
            rows.value,
            rows.to_position,
            rows.to_velocity,
            rows.sample,
            rows.group,
            rows.violations(),
            list(proof),
            [[at.wait, at.basis.duration] for at in ranked],
            reason,
            [start.ravel() for start in _bent_starts(problem, cold)],
            problem.mating_direction,
            problem.margin,
            problem.R_MW,
            [
                units.length,
                units.mass,
                units.time,
                units.query.t0,
                *units.query.state,
                units.query.limits.planned_force,
            ],
        ]
    return found


def _refusals() -> Any:
    free, limits = query(solid=_BOXES), Limits()
    moving = np.array([0.1, -1.5, 0.2, 0.0, 0.1, 0.0])
    unboxed = replace(limits, keep_in=np.full(3, np.inf))
    at_start = [
        replace(free, state=np.array([0.81, -1.5, 0.0, 0.0, 0.0, 0.0])),
        replace(free, limits=unboxed, state=np.array([0.0, -9.0, 0.0, 0.0, 0.0, 0.0])),
        replace(free, state=2.0 * moving),
        replace(free, state=np.array([0.0, -0.55, 0.0, 0.0, 0.0, 0.0])),
        replace(free, limits=replace(limits, least_range=1.6)),
        replace(free, limits=replace(limits, line_of_sight_rate=0.03), state=moving + 0.05 * np.eye(6)[3]),
        replace(free, state=np.array([0.0, -0.6, 0.0, 0.0, 0.11, 0.0]), margin=np.zeros_like),
    ]
    at_end = [
        free,
        replace(free, mating_point=np.array([0.1, 0.0, 0.2])),
        replace(free, mating_point=np.array([0.9, 0.0, 0.9])),
        replace(free, state=np.array([0.79, -1.5, 0.0, 0.09, 0.0, 0.0])),
        replace(free, limits=replace(limits, speed=0.02)),
        replace(free, limits=replace(limits, planned_force=0.02)),
        replace(free, limits=replace(limits, line_of_sight_rate=0.03)),
        replace(free, limits=replace(limits, least_range=0.5)),
    ]
    waits = (5.0, 0.0, 2.0, 12.0, 40.0)
    return {
        "start": [start_problem(one) for one in at_start],
        "end": [terminal_problem(approach_problem(one, 1.0, 30.0, 11, 31)) for one in at_end],
        "waits": [
            possible_waits(replace(one, waits=waits))
            for one in (free, at_start[3], replace(free, state=np.array([-0.3, 0.6, 0.3, 0, 0, 0])), at_start[6])
        ],
        "moving": _ranked_problems(replace(free, state=moving, waits=(2.0,)), 11, 31)[1],
    }


def _target(target: Target) -> Any:
    points = np.array([[0.9, 0.2, -0.3], [-0.4, 0.6, 0.1], [0.05, 0.0, 0.02], [0.3, 0.21, 0.0]])
    return [
        *target.solid.distances(points),
        target.solid.vertices,
        target.mesh.corners,
        target.inertia,
        target.principal,
        target.R_MT,
        target.swept_radius,
        target.landmark,
        target.mating_point,
    ]


def _tumble(plugin: Parameter, streams: Streams) -> Any:
    return tuple(value[0] for value in tumble_states("tumble", plugin(Draw(streams, "tumble")), 1))


def _targets() -> Any:
    boxes = (
        Box(half_size=(0.3, 0.2, 0.1)),
        Box(centre=(0.5, 0.1, 0.0), half_size=(0.2, 0.02, 0.1), rotation=(0.2, 0.3, 0)),
    )
    path = str(Path(__file__).with_name("bracket.obj"))
    streams = Streams(3, np.zeros(1, np.int64), np.array([2]))
    times = np.array([0.0, 1.0, 2.0, 5.0, 9.0])
    tumbling = _tumble(TriAxialTumble(rate=0.1), streams)
    return {
        "boxes": _target(BoxTarget(boxes=boxes)()),
        "given": _target(
            BoxTarget(boxes=boxes, inertia=((2, 0.1, 0), (0.1, 3, 0), (0, 0, 4)), mating_point=(0.4, 0, 0.1))()
        ),
        "envisat": _target(EnvisatTarget(scale=0.1)()),
        "mesh": _target(MeshTarget(path=path)()),
        "mesh, given": _target(MeshTarget(path=path, scale=0.5, inertia=((2, 0, 0), (0, 3, 0), (0, 0, 4)))()),
        "tumbles": [
            tumbling,
            _tumble(TriAxialTumble(attitude=(0.6, 0.0, 0.0, 0.8)), streams),
            _tumble(RandomTumble(), streams),
        ],
        "struck": target_motion(np.array([0.2, 0.9, 1.0]), tumbling, (1.5, 5.0), times),
    }


def _sensors() -> Any:
    """Return what all sensors but the camera give in 14 steps, some of them failing."""
    faults = (
        "mission.faults=[{kind: imu, start: 0.6 s, duration: 0.4 s}, {kind: imu_bias, start: 1.2 s, duration: 0.6 s}, "
        "{kind: camera, start: 1.9 s, duration: 0.3 s}]"
    )
    settings = (
        "mission.control_ticks=5",
        "mission.update_ticks=10",
        "mission.tick=40 ms",
        "sensors.imu_ticks=3",
        faults,
        "sensors.frame_period=0.4 s",
        "sensors.poses={keyframe: 9 deg, skips: 2, view_rotation: 1 deg}",
        "sensors.state={attitude_sigma: 1 deg, rate_sigma: 0.1 deg/s, correlation: 0.6}",
    )
    config = load_rendezvous(configs_root() / "tumbling-rendezvous" / "experiment-truth.yml", settings).config
    suite = SensorSuite(config, config.target(), STREAMS, ("poses", "inertial", "state"))
    random, found = np.random.default_rng(0), []
    level, turned = np.array([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]), np.array([0.0, 0.0, 0.0, 1.0])
    for k in range(14):
        angle = 0.12 * k
        chaser = BodyState(
            np.array([0.1, -1.5, 0.02 * k]), random.normal(size=3), level if k != 8 else turned, np.zeros(3)
        )
        q = np.array([np.sin(angle), 0.0, 0.0, np.cos(angle)])
        body = BodyState(np.array([0.01, 0.0, 0.0]), np.zeros(3), q, np.array([0.24, 0.0, 0.1]))
        trace = None
        if k:
            trace = ChaserTrace(*(random.normal(size=(5, size)) for size in (3, 3, 4, 3, 6)))
        read = suite.read(0.2 * k, chaser, body, trace)
        frame, state = read.frame, read.state
        assert state is not None
        edges = frame.poses if isinstance(frame, PoseFrame) else ()
        found.append(
            [
                read.start is None,
                sorted(read.silent),
                frame is None,
                None if frame is None else list(frame.flags),
                [[one.first, one.second, one.kind, one.pose, one.covariance] for one in edges],
                [[*one.acceleration, *one.rate, one.time] for one in read.samples],
                None if state.target is None else [state.target.orientation, state.target.angular_velocity],
            ]
        )
    return found


PIECES: Pieces = {
    "plans": _plans,
    "parts of plans": _parts_of_plans,
    "refusals of plans": _refusals,
    "targets": _targets,
    "sensors": _sensors,
}
