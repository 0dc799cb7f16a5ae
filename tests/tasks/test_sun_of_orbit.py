"""The sun on other orbits: beta angle, elliptic and precessing orbits, and what must not be combined with them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.dynamics import RelativeOrbit
from safe_inspect.dynamics.orbit.earth import EARTH_RADIUS
from safe_inspect.dynamics.orbit.relative_orbit_row import in_inertial_axes
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.errors import ConfigError, SafeInspectError
from safe_inspect.evaluation.results.collector import EpisodeCollector
from safe_inspect.evaluation.task import default_metrics
from safe_inspect.random.streams import Streams
from safe_inspect.tasks.inspection.sun import sun_directions
from safe_inspect.types import FloatArray

RECIPE = configs_root() / "translational-inspection/experiment.yml"
STEPS = 612


def environment(*overrides: str, rows: int = 4) -> TeamEnvironment:
    return TeamEnvironment(load_experiment(RECIPE, list(overrides)).spec, rows, seed=5)


def fly(environment: TeamEnvironment, steps: int = STEPS) -> dict[str, FloatArray]:
    environment.reset()
    names = [name for name in ("sun_angle", "beta_angle", "sun_direction", "sunlight", "chief_orbit")
             if name in environment.state.arrays]  # fmt: skip
    found: dict[str, list[FloatArray]] = {name: [environment.state[name].copy()] for name in names}
    control = np.zeros_like(environment.state.control)
    for _ in range(steps):
        environment.simulation.step(control)
        for name in names:
            found[name].append(environment.simulation.state[name].copy())
    return {name: np.array(rows) for name, rows in found.items()}


def inertial(orbit: FloatArray, vector: FloatArray) -> FloatArray:
    """Return vectors of Hill's frame in inertial axes by rotation matrices."""
    i, u, node = orbit[3:]

    def about(axis: int, a: float) -> FloatArray:
        found, (p, q) = np.eye(3), [(1, 2), (2, 0), (0, 1)][axis]
        found[p, p] = found[q, q] = math.cos(a)
        found[p, q], found[q, p] = -math.sin(a), math.sin(a)
        return found

    return np.asarray(about(2, node) @ about(0, i) @ about(2, u) @ vector)


def test_the_sun_of_an_elliptic_precessing_orbit_stays_in_inertial_space() -> None:
    found = fly(environment("dynamics={functor: RelativeOrbit, config: {eccentricity: 0.1, inclination: 50 deg}}",
                            "illumination_params.beta_angle=30 deg"))  # fmt: skip
    for row in range(4):
        fixed = np.array(
            [inertial(o, d) for o, d in zip(found["chief_orbit"][:, row], found["sun_direction"][:, row], strict=True)]
        )
        np.testing.assert_allclose(fixed, np.tile(fixed[0], (STEPS + 1, 1)), atol=1e-12)
    np.testing.assert_allclose(
        sun_directions(found["sun_angle"], found["beta_angle"]), found["sun_direction"], atol=1e-12
    )
    assert found["beta_angle"][0] == pytest.approx(math.radians(30.0))
    assert np.ptp(found["beta_angle"]) > 1e-4, "the plane precesses"
    assert np.abs(np.diff(found["sun_angle"], axis=0)).max() < 0.02, "the angle does not jump"
    turned = found["sun_angle"][-1] - found["sun_angle"][0]
    np.testing.assert_allclose(turned, STEPS * 10.0 * 0.001027, rtol=0.01)


def test_a_beta_angle_alone_tilts_the_sun_and_shortens_the_eclipse() -> None:
    dark = []
    for beta in (0.0, 50.0, 70.0):
        found = fly(environment(f"illumination_params.beta_angle={beta} deg", "illumination_params.eclipse=true"))
        np.testing.assert_allclose(found["sun_direction"][..., 2], math.sin(math.radians(beta)))
        np.testing.assert_allclose(np.diff(found["sun_angle"], axis=0), 10.0 * 0.001027, rtol=1e-9)
        dark.append(float((found["sunlight"] < 0.5).mean()))
    orbit = (3.986004418e14 / 0.001027**2) ** (1.0 / 3.0)
    for beta, share in zip((0.0, 50.0), dark, strict=False):
        limb = math.sqrt(1.0 - (EARTH_RADIUS / orbit) ** 2)
        assert share == pytest.approx(math.acos(limb / math.cos(math.radians(beta))) / math.pi, abs=0.003)
    assert dark[2] == 0.0, "no eclipse at a large beta angle"


def test_the_shadow_of_an_elliptic_orbit_depends_on_the_distance() -> None:
    found = fly(environment("dynamics={functor: RelativeOrbit, config: {eccentricity: 0.1}}",
                            "illumination_params.eclipse=true"))  # fmt: skip
    x, distance = found["sun_direction"][..., 0], found["chief_orbit"][..., 0]
    behind = (x < 0.0) & (distance * np.sqrt(np.maximum(1.0 - x * x, 0.0)) < EARTH_RADIUS)
    assert 0.2 < behind.mean() < 0.5
    assert ((found["sunlight"] < 0.5) == behind).mean() > 0.998


def test_orbits_and_beta_angles_are_drawn_at_a_reset(tmp_path: Path) -> None:
    path = tmp_path / "random.yml"
    path.write_text(
        f"- !include {RECIPE.resolve()}\n"
        "- env_config:\n"
        "    simulator: {config: {illumination_params: {beta_angle: 0.0},\n"
        "      dynamics: {functor: RelativeOrbit, config: {eccentricity: 0.02}}}}\n"
        "    simulator_reset_parameters:\n"
        "      eccentricity: {type: UniformParameter, config: {low: 0.0, high: 0.02}}\n"
        "      inclination: {type: UniformParameter, config: {low: 0.0, high: 180.0, units: deg}}\n"
        "      beta_angle: {type: UniformParameter, config: {low: -75.0, high: 75.0, units: deg}}\n"
    )
    spec = load_experiment(path).spec
    whole, alone = TeamEnvironment(spec, 8, seed=5), TeamEnvironment(spec, 1, seed=5)
    whole.reset(), alone.reset()
    orbit, beta = whole.state["chief_orbit"], whole.state["beta_angle"]
    assert len(np.unique(orbit[:, 3])) == 8
    assert len(np.unique(orbit[:, 2])) == 8
    assert len(np.unique(beta)) == 8
    for name in ("chief_orbit", "beta_angle", "sun_direction"):
        assert whole.state[name][:1].tobytes() == alone.state[name].tobytes()


def test_a_drawn_beta_angle_needs_the_field(tmp_path: Path) -> None:
    path = tmp_path / "random.yml"
    path.write_text(
        f"- !include {RECIPE.resolve()}\n"
        "- env_config:\n"
        "    simulator_reset_parameters:\n"
        "      beta_angle: {type: UniformParameter, config: {low: -1.0, high: 1.0}}\n"
    )
    with pytest.raises(SafeInspectError, match=r"nothing uses the reset parameter 'beta_angle'"):
        load_experiment(path)


FILTERED = ("RTAGlueCWHInspection1v1.config.enabled=true",)


@pytest.mark.parametrize(
    "override",
    ["illumination_params.beta_angle=10 deg", "dynamics={functor: RelativeOrbit, config: {oblate: true}}"],
)
def test_the_sun_constraint_is_refused_where_the_sun_leaves_the_plane(override: str) -> None:
    with pytest.raises(SafeInspectError, match="constraint `sun` needs a sun in the orbital plane of a circular orbit"):
        load_experiment(RECIPE, [*FILTERED, override])


def test_a_filter_takes_an_orbit_with_the_bounds_of_its_departure() -> None:
    orbit = "dynamics={functor: RelativeOrbit, config: {eccentricity: 0.005}}"
    constraints = "reference_store.constraints=[chief_collision, r_max, rel_vel, x_vel, y_vel, z_vel]"
    needed = r"disturbed by RelativeOrbit.*; give the filter `disturbance: \{velocity: 0\.0023\}`"
    with pytest.raises(SafeInspectError, match=needed):
        load_experiment(RECIPE, [*FILTERED, orbit, constraints])
    bounded = "RTAGlueCWHInspection1v1.config.disturbance={velocity: 0.003}"
    spec = load_experiment(RECIPE, [*FILTERED, orbit, constraints, bounded]).spec
    assert isinstance(spec.simulator.compose()[0], RelativeOrbit)
    small = "RTAGlueCWHInspection1v1.config.disturbance={velocity: 0.0001}"
    with pytest.raises(
        SafeInspectError, match=r"`velocity` is 0\.002\d*, from RelativeOrbit, which exceeds this bound"
    ):
        load_experiment(RECIPE, [*FILTERED, orbit, constraints, small])


def test_metrics_leave_the_sun_constraint_out_where_the_sun_leaves_the_plane() -> None:
    def labels(*overrides: str) -> set[str]:
        spec: Any = load_experiment(RECIPE, list(overrides)).spec
        return {metric.label for metric in default_metrics(spec)}

    assert labels() - labels("illumination_params.beta_angle=10 deg") == {"phi sun"}


RANDOM = "burn-and-coast-orbits"
_RESET = "config.config.env_config.simulator_reset_parameters"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("eccentricity.config.high=0.0101", r"it is between 0 and 0\.0101, but RelativeOrbit allows 0 to 0\.01"),
        ("eccentricity.config.low=-0.001", r"eccentricity: it is between -0\.001 and 0\.01, but"),
        ("eccentricity={type: TruncatedNormalParameter, config: {std: 0.001}}", r"between -inf and inf, but"),
        ("eccentricity={type: ConstantParameter, config: {value: 0.02}}", r"between 0\.02 and 0\.02, but"),
        ("eccentricity.config.units=m", r"eccentricity\.config\.units: 'eccentricity' is a number without a unit"),
        ("inclination.config={high: 98}", r"98 rad, but .* 0 to 3\.14159 rad; are `units: deg` missing"),
        ("true_anomaly.config.high=400", r"true_anomaly: it is between 0 and 6\.98132 rad, but .*; change one of them"),
        ("beta_angle.config={low: -95.0, units: deg, high: 0}", r"but Sun allows -1\.5708 to 1\.5708 rad"),
    ],
)  # fmt: skip
def test_ranges_of_reset_parameters_are_checked_when_the_file_is_read(given: str, said: str) -> None:
    path = configs_root() / "translational-inspection" / f"experiment-{RANDOM}.yml"
    with pytest.raises(ConfigError, match=said):
        load_experiment(path, [f"{_RESET}.{given}"])


def test_a_reset_parameter_that_needs_a_field_names_it() -> None:
    path = configs_root() / "translational-inspection" / "experiment.yml"
    given = "{type: UniformParameter, config: {low: 0.0, high: 0.01}}"
    with pytest.raises(ConfigError) as raised:
        load_experiment(path, [f"{_RESET}.beta_angle={given}", f"{_RESET}.eccentricity={given}"])
    assert "'beta_angle'; Sun uses it if its `beta_angle` is set, as by `illumination_params`" in str(raised.value)
    assert "'eccentricity'; the dynamics RelativeOrbit use it" in str(raised.value)


def test_evaluations_list_the_elements_of_the_orbits() -> None:
    spec = load_experiment(configs_root() / "translational-inspection" / f"experiment-{RANDOM}.yml", []).spec
    env = TeamEnvironment(spec, 64, seed=3)
    env.reset()
    figures = env.simulation.initial_figures()
    expected = {name: env.simulation._reset_plan.draw(Streams(3, np.arange(64), np.zeros(64, np.int64)))[1][name]
                for name in figures if name != "right_ascension"}  # fmt: skip
    assert list(figures) == [
        "eccentricity", "inclination", "argument_of_perigee", "true_anomaly", "right_ascension"
    ]  # fmt: skip
    assert not figures.pop("right_ascension").any()
    for name, values in figures.items():
        np.testing.assert_allclose(values, expected[name], rtol=1e-7, atol=1e-12)
    collected = EpisodeCollector(env)._initial_states
    assert set(figures) < set(collected)


def test_a_sun_without_a_beta_angle_is_in_the_orbital_plane() -> None:
    angle = np.array([0.3, 2.0])
    expected = np.stack((np.cos(angle), -np.sin(angle), np.zeros(2)), axis=-1)
    np.testing.assert_array_equal(sun_directions(angle), expected)


@pytest.mark.parametrize(
    ("date", "ascension", "declination"),
    [
        # Equinoxes and solstices of 2026 and 2000 to the minute, from the Astronomical Almanac.
        ("2026-03-20T14:46:00", 0.0, 0.0), ("2026-06-21T08:25:00", 90.0, 23.436), ("2026-09-23T00:05:00", 180.0, 0.0),
        ("2026-12-21T20:50:00", 270.0, -23.436), ("2000-06-21T01:48:00+00:00", 90.0, 23.439),
    ],
)  # fmt: skip
def test_the_sun_of_a_date_is_that_of_the_almanac(date: str, ascension: float, declination: float) -> None:
    given = [
        f"illumination_params.date={date}",
        "dynamics={functor: RelativeOrbit, config: {inclination: 98 deg, right_ascension: 40 deg, true_anomaly: 2.0}}",
    ]
    env = environment(*given, rows=3)
    found = fly(env, 30)
    expected = np.radians([ascension, declination])
    across = np.cos(expected[1])
    sun = np.array([across * np.cos(expected[0]), across * np.sin(expected[0]), np.sin(expected[1])])
    for k in (0, 30):
        inertial = np.empty((3, 3))
        in_inertial_axes(found["chief_orbit"][k], found["sun_direction"][k], inertial)
        assert np.degrees(np.arccos(np.clip(inertial @ sun, -1.0, 1.0))).max() < 0.02
    np.testing.assert_allclose(
        sun_directions(found["sun_angle"], found["beta_angle"]), found["sun_direction"], atol=1e-12
    )
    assert np.all(found["chief_orbit"][0, :, 5] == np.radians(40.0))


def test_the_sun_of_a_date_needs_an_orbit_and_a_date() -> None:
    with pytest.raises(SafeInspectError, match="a sun with a `date` needs the dynamics RelativeOrbit"):
        environment("illumination_params.date=2026-03-20")
    with pytest.raises(ConfigError, match=r"illumination_params\.date"):
        environment("illumination_params.date=yesterday")


def test_a_date_in_a_file_stays_a_date_in_what_a_training_writes(tmp_path: Path) -> None:
    """YAML would make it an object that JSON and the resolved experiment cannot contain."""
    path = tmp_path / "dated.yml"
    for written in ("2026-06-21", "2026-06-21 08:25", "2026-06-21T08:25:00Z", "'2026-06-21'"):
        path.write_text(
            "- !include configs/translational-inspection/experiment.yml\n"
            "- env_config: {simulator: {config: {\n"
            f"    illumination_params: {{date: {written}}}, dynamics: RelativeOrbit}}}}}}\n"
        )
        experiment = load_experiment(path, [])
        json.dumps(experiment.tree)
        assert experiment.spec.simulator.illumination_params.date.date().isoformat() == "2026-06-21"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("illumination_params.date=20260320", "expected a date such as '2026-06-21 08:25', got 20260320"),
        ("illumination_params={date: 2026-03-20, beta_angle: 0.1}", "`date` and `beta_angle` exclude each other"),
    ],
)
def test_a_number_is_no_date_and_a_date_excludes_the_beta_angle(given: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        environment(given, "dynamics=RelativeOrbit")
