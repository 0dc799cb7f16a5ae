"""How plugins become numbers of the table: a function for each class. A class without one is called as ever."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from safe_inspect.dones.base import DoneFunction
from safe_inspect.dones.range import CrashDoneFunction, MaxDistanceDoneFunction
from safe_inspect.dones.success import SuccessfulInspectionDoneFunction
from safe_inspect.dones.time_limit import EpisodeLengthDone
from safe_inspect.environments.fused import codes
from safe_inspect.environments.fused.table import Element, End, Term, Translation
from safe_inspect.platforms.base import Sensor
from safe_inspect.platforms.entity_sensors import EntityPositionSensor, EntityVelocitySensor
from safe_inspect.platforms.neighbour_sensors import (
    NearestDeputiesPositionSensor,
    NearestDeputiesPresenceSensor,
    NearestDeputiesVelocitySensor,
)
from safe_inspect.platforms.point_sensors import InspectedPointsSensor, UninspectedPointsSensor
from safe_inspect.platforms.state_sensors import PositionSensor, SunAngleSensor, SunDirectionSensor, VelocitySensor
from safe_inspect.rewards.base import Reward
from safe_inspect.rewards.crash import InspectionCrashReward
from safe_inspect.rewards.delta_v import InspectionDeltaVReward
from safe_inspect.rewards.points import InspectionSuccessReward, ObservedPointsReward
from safe_inspect.rewards.rta import InspectionRTAReward


def elements_of(sensor: Sensor, to: Translation) -> list[Element] | None:
    """Return where the elements of a sensor's reading come from; None for a sensor without a translator."""
    translator = SENSORS.get(type(sensor))
    return None if translator is None else translator(sensor, to)


def term_of(reward: Reward, to: Translation) -> Term:
    """Return a term of the reward, a foreign one for a plugin without a translator."""
    translator = REWARDS.get(type(reward))
    return (None if translator is None else translator(reward, to)) or Term()


def end_of(done: DoneFunction, to: Translation) -> End:
    """Return an end, a foreign one for a plugin without a translator."""
    translator = DONES.get(type(done))
    return (None if translator is None else translator(done, to)) or End()


def _vector(array: str) -> Callable[[Any, Translation], list[Element]]:
    def elements(sensor: Any, to: Translation) -> list[Element]:
        body = getattr(sensor, "entity_name", None)
        return [(codes.FLOAT, to.of_body(array, body, axis)) for axis in range(3)]

    return elements


def _sun_angle(sensor: SunAngleSensor, to: Translation) -> list[Element]:
    return [(codes.ANGLE if sensor.wrap else codes.FLOAT, to.of_environment("sun_angle"))]


def _sun_direction(sensor: SunDirectionSensor, to: Translation) -> list[Element]:
    return [(codes.FLOAT, to.source("sun_direction", axis, 3)) for axis in range(3)]


def _inspected(sensor: InspectedPointsSensor, to: Translation) -> list[Element]:
    array, deputies = f"points/{sensor.inspection_entity_name}/own_count", to.world.num_deputies
    if sensor.inspector_entity_name is None:
        return [(codes.WHOLE, to.source(array, to.group.first, deputies, 1))]
    return [(codes.WHOLE, to.source(array, to.world.bodies[sensor.inspector_entity_name], deputies))]


def _uninspected(sensor: UninspectedPointsSensor, to: Translation) -> list[Element]:
    points = to.world.points[sensor.inspection_entity_name].num_points
    place = to.vector(
        codes.NEAREST_CENTRE,
        3,
        to.of_body("position", sensor.inspector_entity_name),
        to.of_body("position", sensor.inspection_entity_name),
        to.remembered(sensor.part_name, "centres", 3 * -(-points // sensor.points_per_cluster)),
        to.remembered(sensor.part_name, "count", 1),
    )
    return _room(place, 3)


def _nearest(code: int) -> Callable[[Any, Translation], list[Element]]:
    def elements(sensor: Any, to: Translation) -> list[Element]:
        return _room(to.vector(code, sensor.size, sensor.k, limit=sensor.max_range), sensor.size)

    return elements


def _room(place: int, size: int) -> list[Element]:
    return [(codes.ROOM, place + index) for index in range(size)]


def _range(sensor: str | None, to: Translation) -> int | None:
    """Return the place of the range to what a sensor locates; None when it is no sensor of another body."""
    if sensor is None:
        return to.range_to(None)
    located = to.group.sensors[sensor]
    return to.range_to(located.entity_name) if type(located) is EntityPositionSensor else None


def _new_points(reward: ObservedPointsReward, to: Translation) -> Term:
    count = to.of_environment(f"points/{reward.inspection_entity_name}/team_count")
    return Term(codes.NEW_POINTS, count, scale=reward.scale)


def _all_points(reward: InspectionSuccessReward, to: Translation) -> Term:
    body = reward.inspection_entity_name
    count = to.of_environment(f"points/{body}/team_count")
    return Term(codes.ALL_POINTS, count, to.world.points[body].num_points, reward.scale)


def _crash(reward: InspectionCrashReward, to: Translation) -> Term | None:
    place = _range(reward.reference_position_sensor_name, to)
    return None if place is None else Term(codes.NEAR, place, 0, reward.scale, reward.crash_region_radius)


def _fuel(reward: InspectionDeltaVReward, to: Translation) -> Term:
    first, size = to.group.first, to.group.size
    burn = (reward.step_size or to.world.step_size) / (reward.mass or to.world.masses[first : first + size])
    if reward.mode == "constant":
        return Term(codes.FUEL, -1, 0, reward.scale, burn)
    return Term(codes.FUEL, to.of_environment("delta_v_scale"), factor=burn)


def _intervention(reward: InspectionRTAReward, to: Translation) -> Term:
    return Term(codes.INTERVENTION, scale=reward.scale)


def _too_far(done: MaxDistanceDoneFunction, to: Translation) -> End | None:
    place = _range(done.reference_position_sensor_name, to)
    return None if place is None else End(codes.FAR, place, limit=done.max_distance)


def _crashed(done: CrashDoneFunction, to: Translation) -> End | None:
    place = _range(done.reference_position_sensor_name, to)
    return None if place is None else End(codes.CLOSE, place, limit=done.crash_region_radius)


def _inspected_all(done: SuccessfulInspectionDoneFunction, to: Translation) -> End | None:
    if done.weight_threshold is not None:  # NumPy's own order of summation counts
        return None
    body = done.inspection_entity_name
    return End(codes.COUNT, to.of_environment(f"points/{body}/team_count"), to.world.points[body].num_points)


def _horizon(done: EpisodeLengthDone, to: Translation) -> End:
    return End(codes.COUNT, to.of_environment("step"), done.horizon)


#: From a sensor to the elements of its reading.
SENSORS: dict[type[Sensor], Callable[[Any, Translation], list[Element] | None]] = {
    PositionSensor: _vector("position"),
    VelocitySensor: _vector("velocity"),
    EntityPositionSensor: _vector("position"),
    EntityVelocitySensor: _vector("velocity"),
    SunAngleSensor: _sun_angle,
    SunDirectionSensor: _sun_direction,
    InspectedPointsSensor: _inspected,
    UninspectedPointsSensor: _uninspected,
    NearestDeputiesPositionSensor: _nearest(codes.NEAREST_POSITIONS),
    NearestDeputiesVelocitySensor: _nearest(codes.NEAREST_VELOCITIES),
    NearestDeputiesPresenceSensor: _nearest(codes.NEAREST_PRESENCE),
}
#: From a reward to a term; None: with these fields the plugin itself is called.
REWARDS: dict[type[Reward], Callable[[Any, Translation], Term | None]] = {
    ObservedPointsReward: _new_points,
    InspectionSuccessReward: _all_points,
    InspectionCrashReward: _crash,
    InspectionDeltaVReward: _fuel,
    InspectionRTAReward: _intervention,
}
#: From a done function to an end; None as for the rewards.
DONES: dict[type[DoneFunction], Callable[[Any, Translation], End | None]] = {
    MaxDistanceDoneFunction: _too_far,
    CrashDoneFunction: _crashed,
    SuccessfulInspectionDoneFunction: _inspected_all,
    EpisodeLengthDone: _horizon,
}
