"""Observations, rewards, ends and infos of every step, as the small simulation of one deputy has them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from safe_inspect.environments import InspectionEnv, InspectionVectorEnv, load_spec

from .one_deputy import SEED, SHIPPED, TERMS, Ellipse, Flight, OneDeputy, Task

TASKS = {
    "shipped": ("safe_inspect/TranslationalInspection-v1", SHIPPED),
    "seed": ("safe_inspect/TranslationalInspectionSeed-v0", SEED),
}


def start(core, row=0):
    """Return what the environment has drawn: position, velocity, sun angle and the key of an episode's draws."""
    state = core.state
    return state.position[row, 0], state.velocity[row, 0], float(state.sun_angle[row]), int(state.key[row])


def agree(found, flight: Flight, points: int):
    """Compare what a reset or a step gives with the last state of a flight."""
    observation, info = found[0], found[-1]
    np.testing.assert_allclose(observation, flight.observation[-1], rtol=2e-7, atol=2e-7)
    expected = {
        "inspected_count": flight.count,
        "own_inspected_count": flight.count,
        "inspected_fraction": flight.count / points,
        "delta_v": pytest.approx(flight.delta_v[-1], rel=1e-12),
        "status": flight.status,
    }
    if len(found) == 2:
        assert expected.items() <= info.items()
        assert all("/" in name for name in info.keys() - expected.keys())  # statistics of the draw
        return
    terms = flight.terms[-1]
    expected |= {f"reward/{name}": pytest.approx(value, rel=1e-12, abs=1e-15) for name, value in terms.items()}
    assert info == expected
    assert found[1] == pytest.approx(sum(terms.values()), rel=1e-12, abs=1e-15)
    over = flight.status != "running"
    assert found[2:4] == (over and not flight.truncated, flight.truncated)


def controllers(task: Task, sun: float, generator):
    """Return a controller for each way to end, by the status with which it ends."""
    burn = min(task.thrust, 0.1)
    day = Ellipse(burn, phase=sun + math.pi / 2.0)
    night = Ellipse(burn, phase=sun - math.pi / 2.0)
    return {
        "win": day,
        "draw": night,
        "lose": lambda flight: burn * np.sign(np.rint(-flight.position[-1] / 40.0 - 5.0 * flight.velocity[-1])),
        "lose, far": lambda flight: task.thrust * np.sign(flight.position[-1]),
        "lose, random": lambda flight: task.thrust * generator.integers(-1, 2, 3),
    }


@pytest.mark.parametrize("name", TASKS)
def test_episodes_that_follow_one_another(name):
    """Two wins raise the price of fuel at the end of its interval, of 250 or 1,500 steps; other ends lower it again."""
    task_id, task = TASKS[name]
    env, deputy = InspectionEnv(load_spec(task_id)), OneDeputy(task)
    generator, prices = np.random.default_rng(5), []
    ways = ["win", "win", "draw", "lose", "lose, far", "lose, random"]
    for index, way in enumerate(ways):
        first = env.reset(seed=3 if index == 0 else None)
        flight = deputy.reset(*start(env.core))
        agree(first, flight, 100)
        control = controllers(task, flight.sun_angle[0], generator)[way]
        while flight.status == "running":
            thrust = control(flight)
            discrete = name == "shipped"
            found = env.step(np.rint(thrust / 0.1).astype(int) + 1 if discrete else 1.5 * thrust.astype(np.float32))
            deputy.step(thrust if discrete else 1.5 * thrust.astype(np.float32))
            agree(found, flight, 100)
            prices.append(deputy.price)
        np.testing.assert_allclose(env.core.state.position[0, 0], flight.position[-1], rtol=0, atol=1e-7)
        np.testing.assert_allclose(env.core.state.velocity[0, 0], flight.velocity[-1], rtol=0, atol=1e-10)
        assert flight.status == way.partition(",")[0]
        assert (flight.terms[-1]["InspectionCrashReward"] != 0.0) == (way == "lose")
    assert len(set(prices)) >= 2
    assert (prices[-1] > min(prices)) == (name == "shipped")


def test_a_batch_is_as_many_small_simulations():
    """Rewards, ends and infos of `InspectionVectorEnv`, and of the step in which it resets an episode."""
    rows, steps = 4, 330
    env = InspectionVectorEnv(load_spec(TASKS["seed"][0]), rows)
    deputies = [OneDeputy(SEED) for _ in range(rows)]
    observation, info = env.reset(seed=8)
    flights = [deputy.reset(*start(env.core, row)) for row, deputy in enumerate(deputies)]
    generator, ended = np.random.default_rng(1), 0
    for _ in range(steps):
        actions = generator.uniform(-1.0, 1.0, (rows, 3)) * np.array([0.05, 1.0, 0.3, 0.6])[:, None]
        actions = actions.astype(np.float32)
        fresh = [flight.status != "running" for flight in flights]
        observation, reward, terminated, truncated, info = env.step(actions)
        assert {name for name in info if "/" not in name and not name.startswith("_")} == {
            "delta_v", "inspected_count", "own_inspected_count", "inspected_fraction", "status",
        }  # fmt: skip
        for row, deputy in enumerate(deputies):
            if fresh[row]:  # the step is a reset, whose action counts for nothing
                flights[row], ended = deputy.reset(*start(env.core, row)), ended + 1
                assert (reward[row], terminated[row], truncated[row]) == (0.0, False, False)
                assert all(info[f"reward/{term}"][row] == 0.0 for term in TERMS)
            else:
                deputy.step(actions[row])
                terms = flights[row].terms[-1]
                assert reward[row] == pytest.approx(sum(terms.values()), rel=1e-12, abs=1e-15)
                for term, value in terms.items():
                    assert info[f"reward/{term}"][row] == pytest.approx(value, rel=1e-12, abs=1e-15)
                over = flights[row].status != "running"
                assert (terminated[row], truncated[row]) == (over, False)
            flight = flights[row]
            np.testing.assert_allclose(observation[row], flight.observation[-1], rtol=2e-7, atol=2e-7)
            assert info["delta_v"][row] == pytest.approx(flight.delta_v[-1], rel=1e-12)
            assert info["inspected_count"][row] == info["own_inspected_count"][row] == flight.count
            assert info["inspected_fraction"][row] == flight.count / 100
            assert info["status"][row] == ("running", "win", "lose", "draw").index(flight.status)
    assert ended >= 3
