"""Components of tasks: what they refuse, what they offer, and what their parameters mean."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError

from safe_inspect.dynamics.clohessy_wiltshire import ClohessyWiltshire
from safe_inspect.simulators.resets.initializers import AttitudeParameter, PositionVelocityInitializer
from safe_inspect.simulators.resets.parameters import ConstantParameter, UniformParameter
from safe_inspect.simulators.resets.plan import BodyReset, ResetPlan
from safe_inspect.simulators.simulator import ComposedSimulator, Simulation
from safe_inspect.simulators.team import TeamView
from safe_inspect.simulators.view import Group, View
from safe_inspect.tasks.bounded_disturbance import BoundedDisturbance
from safe_inspect.tasks.docking.tumble_parameter import TumbleParameter
from safe_inspect.tasks.inspection.fuel_price import FuelPriceSchedule
from safe_inspect.tasks.inspection.points import InspectionPoints, SpherePoints
from safe_inspect.tasks.inspection.rotation import ChiefRotation
from safe_inspect.tasks.inspection.simulator import InspectionSimulator
from safe_inspect.tasks.inspection.sun import IlluminationParams, Sun

AXES = ("x", "y", "z", "x_dot", "y_dot", "z_dot")
SWAP = "but .* is above .*; swap them"
LENGTH = "all components are 0, which is neither a direction nor an attitude"


@pytest.mark.parametrize(
    ("plugin", "refused", "accepted", "message"),
    [
        (FuelPriceSchedule, {"delta_v_scale_bounds": (-0.1, -0.2)}, {"delta_v_scale_bounds": (-0.1, -0.1)}, SWAP),
        (
            FuelPriceSchedule, {"inspected_points_update_bounds": (0.9, 0.8)},
            {"inspected_points_update_bounds": (0.8, 0.8)}, SWAP,
        ),
        (FuelPriceSchedule, {"steps_until_update": 0}, {"steps_until_update": 1}, "greater than or equal to 1"),
        (InspectionSimulator, {"delta_v_scale_bounds": (-0.1, -0.2)}, {}, SWAP),
        (InspectionSimulator, {"inspected_points_update_bounds": (0.9, 0.8)}, {}, SWAP),
        (InspectionSimulator, {"field_of_view": 3.2}, {"field_of_view": math.pi}, "less than or equal to 3.14"),
        (InspectionPoints, {"field_of_view": 0.0}, {"field_of_view": 1e-3}, "greater than 0"),
        (IlluminationParams, {"render_flag_3d": True}, {"render_flag_3d": False}, "the simulator does not render"),
        (IlluminationParams, {"render_flag_subplots": True}, {}, "the simulator does not render"),
        (
            TumbleParameter, {"rate": AttitudeParameter()}, {"rate": UniformParameter(low=0.0, high=0.1)},
            "must be a number in rad/s or deg/s",
        ),
        (TumbleParameter, {"rate": ConstantParameter(value=1.0, units="m")}, {"rate": ConstantParameter(value=1.0)},
         "must be a number in rad/s or deg/s"),
        (TumbleParameter, {"direction": (0.0, 0.0, 0.0)}, {"direction": (0.0, 0.0, 1e-9)}, LENGTH),
        (AttitudeParameter, {"orientation": (0.0, 0.0, 0.0, 0.0)}, {"orientation": (0.0, 0.0, 0.0, -3.0)}, LENGTH),
    ],
)  # fmt: skip
def test_what_cannot_be_meant_is_refused(plugin, refused, accepted, message):
    plugin(**accepted)
    with pytest.raises(ValidationError, match=message):
        plugin(**refused)


def test_platforms_that_turn_need_dynamics_that_do():
    assert InspectionSimulator().with_attitude().turns
    with pytest.raises(ValueError, match="the platforms turn, but ClohessyWiltshire has no attitude"):
        InspectionSimulator(dynamics=ClohessyWiltshire()).with_attitude()


def simulation(*components, disturbance=None):
    """Return a simulation of two deputies, a chief and a second body."""

    def start(*values):
        given = {name: ConstantParameter(value=value) for name, value in zip(AXES, values, strict=True)}
        return BodyReset(PositionVelocityInitializer(), given)

    plan = ResetPlan(
        {}, {"red": start(60.0, 1.0, 2.0, 0.1, 0.2, 0.3), "blue": start(-40.0, 9.0, 4.0, 0.0, 0.3, 0.0)},
        {"chief": start(*np.zeros(6)), "module": start(0.0, 30.0, 5.0, 0.0, 0.0, 0.0)},
    )  # fmt: skip
    simulator = ComposedSimulator(components=components, disturbance=disturbance)
    found = Simulation(
        *simulator(), masses={"red": 12.0, "blue": 12.0}, groups=(), reset=plan, step_size=10.0, num_envs=3, seed=1,
        first_slot=0,
    )  # fmt: skip
    found.reset(np.arange(3))
    return found


@pytest.mark.parametrize(
    "components", [(ChiefRotation(), Sun(), InspectionPoints()), (Sun(), InspectionPoints(), ChiefRotation())]
)
def test_a_chief_that_rotates_does_so_between_the_sun_and_the_points(components):
    simulation(Sun(), ChiefRotation(), InspectionPoints())
    with pytest.raises(ValueError, match="ChiefRotation must come after Sun and before InspectionPoints"):
        simulation(*components)


def test_points_without_a_sun_before_them_are_refused():
    for light in (IlluminationParams(), None):
        with pytest.raises(ValueError, match="InspectionPoints must come after Sun; put Sun before it"):
            simulation(InspectionPoints(illumination_params=light), Sun())


def test_two_components_do_not_offer_the_same():
    with pytest.raises(ValueError, match=r"two components provide the name '.*'; rename one"):
        simulation(Sun(), Sun())


def test_estimates_are_offered_by_their_names():
    """Of position and velocity, each off by its own error, to a group and to the team."""
    found = simulation(disturbance=BoundedDisturbance(position_error=0.5, velocity_error=0.002, distribution="extreme"))
    found.step(np.full((3, 2, 3), 0.1))
    view = View(found.state, found.world, Group("blue", 1, 1, {}))
    team = TeamView(found.state, found.world)
    for name, error in (("position", 0.5), ("velocity", 0.002)):
        truth = found.state[name]
        own, all_ = getattr(view, f"estimated_{name}"), getattr(team, f"estimated_{name}")
        np.testing.assert_allclose(np.linalg.norm(own - truth[:, 1], axis=-1), error, rtol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(all_ - truth[:, :2], axis=-1), error, rtol=1e-6)


def test_the_points_of_several_bodies_are_counted_together():
    """Those of the team in each environment, and those that each deputy was the first to inspect."""
    numbers = {"chief": 20, "module": 50}
    component = InspectionPoints(
        inspection_points_map={name: SpherePoints(num_points=count, radius=3.0) for name, count in numbers.items()},
        illumination_params=None, report_score=True,
    )  # fmt: skip
    found = simulation(Sun(), component)
    for _ in range(40):
        found.step(np.random.default_rng(3).uniform(-0.1, 0.1, (3, 2, 3)))
    points = found.components["InspectionPoints"]
    inspectors = [found.state.points[name].inspector for name in numbers]
    assert all((one >= 0).any() and (one < 0).any() for one in inspectors)
    total = sum((one >= 0).sum(axis=1) for one in inspectors)
    score = sum((one >= 0).mean(axis=1) for one in inspectors) / 2.0
    team = points.team_info(TeamView(found.state, found.world))
    np.testing.assert_array_equal(team["inspected_count"], total)
    np.testing.assert_allclose(team["inspected_fraction"], total / 70.0)
    np.testing.assert_allclose(team["inspected_score"], score)
    for deputy, name in enumerate(("red", "blue")):
        info = points.info(View(found.state, found.world, Group(name, deputy, 1, {})))
        own = sum((one == deputy).sum(axis=1) for one in inspectors)
        np.testing.assert_array_equal(info["inspected_count"], total)
        np.testing.assert_array_equal(info["own_inspected_count"], own)
        np.testing.assert_allclose(info["inspected_score"], score)
        expected = sum((one == deputy).mean(axis=1) for one in inspectors) / 2.0
        np.testing.assert_allclose(info["own_inspected_score"], expected)


@pytest.mark.parametrize("rate", [0.001027, 0.02])
def test_the_sun_turns_at_its_rate_and_shines_from_its_angle(rate):
    found = simulation(Sun(rate=rate))
    start = found.state["sun_angle"].copy()
    for step in range(8):
        angle = found.state["sun_angle"]
        np.testing.assert_allclose(np.cos(angle - start - rate * 10.0 * step), 1.0, rtol=1e-12)
        np.testing.assert_allclose(np.sin(angle - start - rate * 10.0 * step), 0.0, atol=1e-12)
        direction = np.stack((np.cos(angle), -np.sin(angle), 0.0 * angle), axis=-1)
        np.testing.assert_allclose(found.state["sun_direction"], direction, atol=1e-12)
        found.step(np.zeros((3, 2, 3)))


def test_the_sun_of_an_inspection_turns_with_its_light():
    def rate(**fields):
        return InspectionSimulator(mean_motion=0.0011, **fields).compose()[1][0].rate

    assert rate(illumination_params={"mean_motion": 0.002}) == 0.002
    assert rate(illumination_params=None) == 0.0011


def test_a_sun_that_does_not_follow_the_orbit_is_warned_of(recwarn):
    said = r"the sun turns at 0\.001027 rad/s, and the orbit at 0\.0005 rad/s; set `illumination_params\.mean_motion`"
    with pytest.warns(UserWarning, match=said):
        InspectionSimulator(mean_motion=0.0005)
    with pytest.warns(UserWarning, match=said):
        InspectionSimulator(dynamics={"functor": "RelativeOrbit", "config": {"mean_motion": 0.0005}})
    recwarn.clear()
    for light in ({"mean_motion": 0.001027}, {"mean_motion": 0.0005}, None):
        InspectionSimulator(mean_motion=0.0005, illumination_params=light)
    InspectionSimulator()
    assert not recwarn.list


def test_a_part_of_the_price_schedule_has_the_prices_of_its_slots():
    plugin = FuelPriceSchedule(delta_v_scale_bounds=(-0.5, -0.1), delta_v_scale_step=-0.1)
    running = plugin(SimpleNamespace(offers=SimpleNamespace(world={})), 4)
    running.load_state_dict(
        {"scale": np.array([-0.1, -0.2, -0.3, -0.4]), "steps": np.zeros(4, int), "sum": np.zeros(4),
         "episodes": np.zeros(4, int)}
    )  # fmt: skip
    part = running.part(np.array([2, 0]))
    np.testing.assert_array_equal(part.state_dict()["scale"], [-0.3, -0.1])
    np.testing.assert_array_equal(running.state_dict()["scale"], [-0.1, -0.2, -0.3, -0.4])
    part.load_state_dict(
        {name: array + 0.0 for name, array in part.state_dict().items()} | {"scale": np.full(2, -0.45)}
    )
    running.join(part, np.array([2, 0]))
    np.testing.assert_array_equal(running.state_dict()["scale"], [-0.45, -0.2, -0.45, -0.4])
