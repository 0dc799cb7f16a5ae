"""`RelativeOrbit` against Basilisk: two spacecraft about the oblate Earth, with drag, for an orbit.

    pip install bsk && python benchmarks/basilisk_orbit.py

Basilisk (https://avslab.github.io/basilisk) integrates both spacecraft in inertial axes, with degree-2 gravity and its
exponential atmosphere. The largest differences of the relative states are printed.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from Basilisk.simulation import dragDynamicEffector, exponentialAtmosphere, spacecraft, svIntegrators
from Basilisk.utilities import SimulationBaseClass, macros, simIncludeGravBody

from safe_inspect.dynamics import Drag, RelativeOrbit
from safe_inspect.dynamics.orbit.earth import EARTH_GRAVITY, EARTH_J2, EARTH_RADIUS, semi_major_axis
from safe_inspect.dynamics.orbit.relative_orbit_row import orbit_row, relative_orbit_row
from safe_inspect.types import FloatArray

STEP, MASS = 10.0, 12.0
#: Basilisk's density is that of the start of its step [s], which therefore must be short with drag.
AIR_STEP = 0.05
START = np.array([80.0, -60.0, 20.0, 0.03, -0.1, 0.02])


def chief_at(orbit: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return position, velocity and Hill's axes (as rows) of a chief in inertial axes, for an orbit of shape (6,)."""
    r, radial, h, i, u, node = orbit
    cos, sin = np.cos([node, u, i]), np.sin([node, u, i])
    x = np.array(
        [cos[0] * cos[1] - sin[0] * sin[1] * cos[2], sin[0] * cos[1] + cos[0] * sin[1] * cos[2], sin[1] * sin[2]]
    )
    z = np.array([sin[0] * sin[2], -cos[0] * sin[2], cos[2]])
    axes = np.array([x, np.cross(z, x), z])
    return r * x, radial * x + h / r * axes[1], axes


def frame_rate(position: FloatArray, velocity: FloatArray) -> FloatArray:
    """Return the angular velocity of Hill's frame in inertial axes [rad/s]."""
    h, r = np.cross(position, velocity), np.linalg.norm(position)
    out = -3.0 * EARTH_J2 * EARTH_GRAVITY * EARTH_RADIUS**2 / r**5 * position[2]  # of the oblateness, along the pole
    across = out * h[2] / np.linalg.norm(h)
    return np.asarray(h / r**2 + r * across / np.linalg.norm(h) * position / r)


def basilisk(states: list[tuple[FloatArray, FloatArray]], drag: Drag | None, axis: float, steps: int) -> FloatArray:
    """Return the inertial states of the spacecraft at every step, shape (steps + 1, spacecraft, 6)."""
    sim = SimulationBaseClass.SimBaseClass()
    process = sim.CreateNewProcess("process")
    step, every = macros.sec2nano(STEP if drag is None else AIR_STEP), macros.sec2nano(STEP)
    process.addTask(sim.CreateNewTask("task", step))
    bodies = simIncludeGravBody.gravBodyFactory()
    earth = bodies.createEarth()
    earth.isCentralBody, earth.mu, earth.radEquator = True, EARTH_GRAVITY, EARTH_RADIUS
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "degree2.txt"
        terms = ["2,0,%.17e,0.0" % (-EARTH_J2 / math.sqrt(5.0)), "2,1,0.0,0.0", "2,2,0.0,0.0"]
        file.write_text(
            "\n".join(
                [f"{EARTH_RADIUS},{EARTH_GRAVITY},0,2,2,1,0,0", "0,0,1.0,0.0", "1,0,0.0,0.0", "1,1,0.0,0.0", *terms]
            )
        )
        earth.useSphericalHarmonicsGravityModel(str(file), 2)
        kept: list[Any] = []
        air = exponentialAtmosphere.ExponentialAtmosphere()
        if drag is not None:
            air.ModelTag, air.planetRadius = "air", EARTH_RADIUS
            height = axis - EARTH_RADIUS
            air.scaleHeight = drag.scale_height
            air.baseDensity = drag.density * math.exp(height / drag.scale_height)
            sim.AddModelToTask("task", air)
        recorders = []
        for index, (position, velocity) in enumerate(states):
            craft = spacecraft.Spacecraft()
            craft.ModelTag, craft.hub.mHub = f"craft{index}", MASS
            craft.hub.r_CN_NInit, craft.hub.v_CN_NInit = position.tolist(), velocity.tolist()
            craft.gravField.gravBodies = spacecraft.GravBodyVector(list(bodies.gravBodies.values()))
            integrator = (svIntegrators.svIntegratorRKF78 if drag is None else svIntegrators.svIntegratorRK4)(craft)
            craft.setIntegrator(integrator)
            sim.AddModelToTask("task", craft)
            if drag is not None:
                effector = dragDynamicEffector.DragDynamicEffector()
                effector.coreParams.projectedArea = (drag.chief, drag.deputy)[index] * MASS
                effector.coreParams.dragCoeff = 1.0
                air.addSpacecraftToModel(craft.scStateOutMsg)
                effector.atmoDensInMsg.subscribeTo(air.envOutMsgs[index])
                craft.addDynamicEffector(effector)
                sim.AddModelToTask("task", effector)
                kept.append(effector)
            recorder = craft.scStateOutMsg.recorder(every)
            sim.AddModelToTask("task", recorder)
            recorders.append(recorder)
            kept += [craft, integrator]
        sim.InitializeSimulation()
        sim.ConfigureStopTime(steps * every)
        sim.ExecuteSimulation()
    return np.stack([np.hstack((recorder.r_BN_N, recorder.v_BN_N)) for recorder in recorders], axis=1)


def compare(e: float, drag: Drag | None) -> tuple[float, float]:
    """Return the largest differences of position [m] and velocity [m/s] in an orbit."""
    plugin = RelativeOrbit(eccentricity=e, inclination=0.9, argument_of_perigee=0.4, true_anomaly=1.0, drag=drag)
    axis = semi_major_axis(plugin.mean_motion)
    steps = round(2.0 * math.pi / plugin.mean_motion / STEP)
    orbit = np.array(plugin.reset_shared({}, 1)["chief_orbit"])[0]
    position, velocity, axes = chief_at(orbit)
    offset = axes.T @ START[:3]
    deputy = position + offset, velocity + axes.T @ START[3:] + np.cross(frame_rate(position, velocity), offset)
    found = basilisk([(position, velocity), deputy], drag, axis, steps)
    (constants,) = plugin(STEP)
    own, speed, errors = START[:3].copy(), START[3:].copy(), []
    for k in range(steps + 1):
        chief, other = found[k]
        _, _, axes = chief_at(orbit)
        h = np.cross(chief[:3], chief[3:])
        x, z = chief[:3] / np.linalg.norm(chief[:3]), h / np.linalg.norm(h)
        axes = np.array([x, np.cross(z, x), z])
        apart = other[:3] - chief[:3]
        moving = axes @ (other[3:] - chief[3:] - np.cross(frame_rate(chief[:3], chief[3:]), apart))
        errors.append((np.abs(axes @ apart - own).max(), np.abs(moving - speed).max()))
        relative_orbit_row(constants, orbit, own, speed, np.zeros(3), MASS)
        orbit_row(constants, orbit)
    largest = np.max(errors, axis=0)
    return float(largest[0]), float(largest[1])


if __name__ == "__main__":
    print("largest differences from Basilisk in an orbit, at a range of 100 m and more")
    for e in (0.0, 0.01, 0.1):
        for drag in (None, Drag(density=1e-12, scale_height=300e3)):
            apart, moving = compare(e, drag)
            print(f"e {e:g}, {'no drag' if drag is None else 'drag'}: {apart:.2e} m, {moving:.2e} m/s")
