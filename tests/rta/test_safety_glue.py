"""The safety glue in the environment: off it changes nothing, on it keeps every constraint, whatever is asked for."""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from safe_inspect.config.building.world import common_world
from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import BatchedEnvironment, InspectionEnv, InspectionVectorEnv
from safe_inspect.environments.episodes import state_info, transition_info
from safe_inspect.errors import ConfigError, PluginValueError, UnsafeInitialStateWarning
from safe_inspect.plugins.registry import registry
from safe_inspect.random.streams import Streams
from safe_inspect.rta.adversaries import adversarial_thrust
from safe_inspect.rta.backup.safety_filter import BackupFilter
from safe_inspect.rta.constraints import Constraint, RelativeState
from safe_inspect.rta.constraints.base import ConstraintValues
from safe_inspect.rta.inspection import RTAGlueCWHInspection1v1
from safe_inspect.simulators.resets.parameters import Draw

ON = "RTAGlueCWHInspection1v1.config.enabled=True"
GLUE = "agent_config.blue0_ctrl.config.config.glues.0.config"
SEED = 11


@pytest.fixture(scope="session")
def spec_with(shipped):
    """Return a function that loads the shipped task with overrides; each variant is loaded once."""
    known = {}

    def load(*overrides):
        if overrides not in known:
            known[overrides] = load_experiment(shipped, overrides).spec
        return known[overrides]

    return load


def relative(env):
    state = env.state
    return RelativeState(state.position[:, 0].copy(), state.velocity[:, 0].copy(), state.sun_angle.copy())


def phi_of(env):
    """Return the smallest safety quantity of each constraint, by the glue of the agent."""
    glue = env.spec.agents[0].action_glues[0]
    state = relative(env)
    return glue.safety({"position": state.position, "velocity": state.velocity, "sun_angle": state.sun_angle})


def random_thrusts(steps, num_envs, seed=0):
    return np.random.default_rng(seed).uniform(-1.3, 1.3, (steps, num_envs, 1, 3))


def test_the_glue_asks_for_the_sum_of_what_it_wraps(spec_with):
    agent = spec_with().agents[0]
    (glue,) = agent.action_glues
    action = np.random.default_rng(1).uniform(-1.0, 1.0, (5, 3))
    low, high = glue.bounds(agent.parts)
    np.testing.assert_array_equal((low, high), ([-1.0] * 3, [1.0] * 3))
    np.testing.assert_array_equal(glue(action, agent.parts), action)
    assert len(glue.names(agent.parts)) == 3
    assert len(glue.leaves()) == 3


def test_off_it_changes_and_reports_nothing(spec_with):
    env = BatchedEnvironment(spec_with(), 8, seed=SEED)
    env.reset()
    assert "interventions" not in state_info(env.view())
    for thrust in random_thrusts(5, 8):
        transition = env.step(thrust)
        step = transition.step
        np.testing.assert_array_equal(step.desired_control, np.clip(thrust[:, 0], -1.0, 1.0))
        np.testing.assert_array_equal(step.control, step.desired_control)
        assert step.filtered is None
        assert not step.intervening.any()
        shown = transition_info(transition)
        assert not [name for name in shown if name.startswith("rta/") or name == "interventions"]
    np.testing.assert_array_equal(env.state.interventions, 0)


def test_on_every_constraint_holds_under_adversaries(spec_with):
    env = BatchedEnvironment(spec_with(ON), 64, seed=SEED)
    env.reset()
    assert min(phi.min() for phi in phi_of(env).values()) >= 0.0
    slots, touched = np.arange(64), np.zeros(8, dtype=bool)
    generator = np.random.default_rng(2)
    for hold in range(40):
        # two of three rows are random, the others fly the scripted adversaries
        thrust = generator.uniform(-1.0, 1.0, (64, 3))
        scripted = slots % 3 == 0
        thrust[scripted] = adversarial_thrust(env.view(), hold, slots // 3, SEED)[scripted]
        transition = env.step(thrust[:, None])
        for name, phi in phi_of(env).items():
            assert (phi >= 0.0).all(), (hold, name, phi.min())
        step = transition.step
        away = np.linalg.norm(step.control - step.desired_control, axis=1)
        np.testing.assert_array_equal(step.intervening, away > 0.01)
        np.testing.assert_array_equal(step.desired_control, thrust)
        assert (np.abs(step.control) <= 1.0).all()
        assert not step.filtered.infeasible.any()
        assert (step.filtered.active[step.intervening & ~step.filtered.backup] != 0).all()
        touched |= [(step.filtered.active >> j & 1).any() for j in range(8)]
        assert not transition.terminated.any()  # neither a crash nor out of range
    assert touched[1]  # the adversaries did press against the speed limit
    assert touched[2]  # and against the sun cone


def test_the_continuous_form_breaks_the_speed_limit_where_the_default_does_not(spec_with):
    """Why the default differs from safe-autonomy-sims: a condition at the start of a hold says nothing of its end."""
    least = {}
    for method in ("backup", "continuous"):
        env = BatchedEnvironment(spec_with(ON, f"{GLUE}.method={method}"), 32, seed=SEED)
        env.reset()
        slots, smallest = np.arange(32), np.inf
        for hold in range(30):
            env.step(adversarial_thrust(env.view(), hold, slots, SEED)[:, None])
            smallest = min(smallest, phi_of(env)["rel_vel"].min())
        least[method] = smallest
    assert least["backup"] >= 0.0
    assert least["continuous"] < -0.1


def test_the_reward_pays_exactly_on_intervention(spec_with):
    pay = "agent_config.0.config.config.rewards.1={name: rta, functor: InspectionRTAReward, config: {scale: -0.05}}"
    env = BatchedEnvironment(spec_with(ON, pay), 64, seed=SEED)
    env.reset()
    strength = np.where(np.arange(64) % 2, 1.0, 0.002)[:, None, None]
    seen = set()
    for thrust in random_thrusts(15, 64):
        transition = env.step(strength * thrust)
        intervening = transition.step.intervening
        np.testing.assert_array_equal(transition.terms["rta"][:, 0], np.where(intervening, -0.05, 0.0))
        seen |= set(intervening.tolist())
    assert seen == {True, False}


def test_delta_v_counts_what_was_flown(spec_with):
    env = BatchedEnvironment(spec_with(ON), 16, seed=SEED)
    env.reset()
    flown, desired = np.zeros(16), np.zeros(16)
    for thrust in random_thrusts(20, 16):
        step = env.step(thrust).step
        flown += np.abs(step.control).sum(axis=1) * 10.0 / 12.0
        desired += np.abs(step.desired_control).sum(axis=1) * 10.0 / 12.0
    np.testing.assert_allclose(env.view().delta_v, flown, rtol=1e-12)
    assert (flown < 0.9 * desired).all()


def test_interventions_accumulate_and_begin_again_with_the_episode(spec_with):
    env = BatchedEnvironment(spec_with(ON), 12, seed=SEED)
    env.reset()
    np.testing.assert_array_equal(state_info(env.view())["interventions"], 0)
    count = np.zeros(12, dtype=int)
    for thrust in random_thrusts(10, 12):
        transition = env.step(thrust)
        count += transition.step.intervening
        np.testing.assert_array_equal(transition_info(transition)["interventions"], count)
    assert count.max() > 1
    env.reset(np.array([0, 5]))
    count[[0, 5]] = 0
    np.testing.assert_array_equal(env.view().interventions, count)
    count += env.step(random_thrusts(1, 12, seed=9)[0]).step.intervening
    np.testing.assert_array_equal(env.view().interventions, count)


def test_the_single_facade_names_what_it_did(spec_with):
    env = InspectionEnv(spec_with(ON))
    _, info = env.reset(seed=SEED)
    assert info["interventions"] == 0
    total = 0
    for thrust in random_thrusts(10, 1)[:, 0, 0]:
        *_, info = env.step(thrust)
        np.testing.assert_array_equal(info["desired_control"], np.clip(thrust, -1.0, 1.0))
        away = np.linalg.norm(info["control"] - info["desired_control"])
        assert info["rta/intervening"] == (away > 0.01)
        assert info["rta/phi_min"] >= 0.0
        assert not info["rta/infeasible"]
        assert set(info["rta/active"]) <= set(phi_of(env.core))
        assert bool(info["rta/active"]) or not info["rta/intervening"]
        total += info["rta/intervening"]
        assert info["interventions"] == total
    assert total > 0


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_the_vector_facade_counts_interventions_by_episode(spec_with, mode):
    env = InspectionVectorEnv(spec_with(ON, "horizon=6"), 3, autoreset_mode=mode, seed=SEED)
    _, info = env.reset()
    np.testing.assert_array_equal(info["interventions"], 0)
    finals = 0
    for thrust in random_thrusts(15, 3)[:, :, 0]:
        _, _, terminated, truncated, info = env.step(thrust)
        if (terminated | truncated).all():
            last = info["final_info"] if mode == "SameStep" else info
            assert (last["interventions"] > 0).all()
            finals += 1
        # whatever the mode: the count is that of the episode whose observation is returned
        np.testing.assert_array_equal(info["interventions"], env.core.view().interventions)
    assert finals == 2


@pytest.mark.parametrize("method", ["backup", "continuous"])
def test_a_row_of_a_batch_is_the_environment_alone(spec_with, method):
    spec = spec_with(ON, f"{GLUE}.method={method}", "horizon=25")
    thrusts = random_thrusts(60, 7)

    def fly(env, given, rows):
        seen = [env.reset()[rows]]
        for thrust in given:
            transition = env.step(thrust)
            done = np.flatnonzero(transition.done[:, 0])
            if len(done):
                env.reset(done)
            step = transition.step
            seen += [transition.observation[rows], transition.reward[rows], step.control[rows]]
            seen += [step.intervening[rows], step.filtered.active[rows], step.filtered.phi[rows]]
            seen += [env.state.interventions[rows], env.state.position[rows]]
        return [array.copy() for array in seen]

    batch = BatchedEnvironment(spec, 7, seed=SEED)
    whole = fly(batch, thrusts, [0, 3, 6])
    for index, row in enumerate((0, 3, 6)):
        alone = fly(BatchedEnvironment(spec, 1, seed=SEED, first_slot=row), thrusts[:, row : row + 1], [0])
        assert len(alone) == len(whole)
        for ours, theirs in zip(whole, alone, strict=True):
            assert ours[index].tobytes() == theirs[0].tobytes()


def test_every_start_is_recoverable_where_the_filter_needs_it(spec_with):
    def begun(*overrides):
        env = BatchedEnvironment(spec_with(*overrides), 3000, seed=SEED)
        env.reset()
        return relative(env)

    backup = BackupFilter()
    off, on = begun(), begun(ON)
    assert not backup.recoverable(off).all()  # so the filter's test says more than the constraints' own
    assert backup.recoverable(on).all()
    continuous = begun(ON, f"{GLUE}.method=continuous")
    np.testing.assert_array_equal(continuous.position, off.position)
    np.testing.assert_array_equal(continuous.velocity, off.velocity)
    # rows whose first draw is recoverable keep it
    kept = (on.position == off.position).all(axis=1)
    np.testing.assert_array_equal(kept, backup.recoverable(off))


FASTER = "vel_mag.config.high=0.6"


@pytest.mark.parametrize("overrides", [(FASTER,), (FASTER, ON)], ids=["off", "on"])
def test_the_reset_info_counts_the_draws(spec_with, overrides):
    """Draws are one more than those refused; the draws are repeated here one by one."""
    spec = spec_with(*overrides)
    vector = InspectionVectorEnv(spec, 200, seed=SEED)
    _, info = vector.reset()
    sampler = spec.reset.parameters["init_state"]
    streams = Streams(SEED, np.arange(200), np.zeros(200, dtype=np.int64))
    waiting, refusals = np.arange(200), np.zeros(200, dtype=int)
    counted = {}
    for attempt in range(50):
        _, refused = sampler.candidates(Draw(streams, "init_state", values={}), waiting, attempt)
        again = np.zeros(len(waiting), dtype=bool)
        for name, rows in refused.items():
            counted.setdefault(name, np.zeros(200, dtype=int))[waiting] += rows
            again |= rows
        waiting = waiting[again]
        refusals[waiting] += 1
        if not len(waiting):
            break
    assert refusals.max() > 1
    np.testing.assert_array_equal(info["rejections/draws"], 1 + refusals)
    for name, count in counted.items():
        np.testing.assert_array_equal(info[f"rejections/{name}"], count)
    assert ("rejections/recoverable" in info) == (ON in overrides)
    row = int(np.argmax(refusals))
    _, single = InspectionEnv(spec, slot=row).reset(seed=SEED)
    shown = {name: value for name, value in single.items() if name.startswith("rejections/")}
    assert shown == {name: info[name][row] for name in shown}
    assert shown["rejections/draws"] == 1 + refusals[row]


@pytest.fixture
def copied(long_form: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "configs" / "translational-inspection"
    shutil.copytree(long_form / folder.name, folder)
    monkeypatch.chdir(tmp_path)
    return folder


@pytest.fixture
def own_constraint() -> Iterator[None]:
    """Register two constraints that the backup filter does not know, and forget them."""
    before = dict(registry.items("constraint"))

    class OwnConstraint(Constraint):
        """Climb slower than 5 m/s."""

        def evaluate(self, state):
            """Return h = phi = 5 m/s - v_z."""
            h = 5.0 - state.velocity[:, 2]
            gradient = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, -1.0], (len(state), 1))
            return ConstraintValues(h, h, gradient, np.zeros(len(state)))

    class Slab(Constraint):
        """Stay below z = 300 m, whatever the velocity."""

        def evaluate(self, state):
            """Return h = phi = 300 m - z."""
            h = 300.0 - state.position[:, 2]
            gradient = np.tile([0.0, 0.0, -1.0, 0.0, 0.0, 0.0], (len(state), 1))
            return ConstraintValues(h, h, gradient, np.zeros(len(state)))

    yield
    registry._classes["constraint"] = before


def problem_of(folder, file, right, wrong, at):
    path = folder / file
    text = path.read_text()
    assert right in text
    path.write_text(text.replace(right, wrong, 1))
    line = path.read_text().partition(at)[0].count("\n") + 1
    with pytest.raises(ConfigError) as caught:
        load_experiment("configs/translational-inspection/experiment-seed.yml")
    return str(caught.value), f"configs/translational-inspection/{file}:{line} "


OFF_LINE = "          enabled: False\n"


@pytest.mark.parametrize(
    ("lines", "at", "words"),
    [
        ("enabled: True\n          method: contnuous", "method: ", ["method", "did you mean `continuous`?"]),
        ("enabled: True\n          intervention: neerest", "intervention", ["intervention", "did you mean `nearest`?"]),
        ("enabled: maybe", "enabled: maybe", ["enabled", "true", "'maybe'"]),
        ("enabled: 5", "enabled: 5", ["enabled", "true", "5"]),
        ("enabled: True\n          infeasible: ignore", "infeasible", ["infeasible", "'pass'", "'ignore'"]),
        ("enabld: True", "enabld", ["enabld", "did you mean `enabled`?"]),
    ],
)  # fmt: skip
def test_a_wrong_field_is_named_with_its_line(copied, lines, at, words):
    text, where = problem_of(copied, "agent-seed.yml", OFF_LINE, f"          {lines}\n", at)
    assert text.startswith(f"{where}agent_config[0].config.config.glues[0].config.")
    assert "\n" not in text
    for word in words:
        assert word in text


def test_an_intervention_belongs_to_the_method_backup():
    assert RTAGlueCWHInspection1v1(intervention="backup").backup_filter.intervention == "backup"
    with pytest.raises(ValueError, match="the method 'continuous' does not support `intervention` 'backup'"):
        RTAGlueCWHInspection1v1(intervention="backup", method="continuous")


@pytest.mark.parametrize(
    ("right", "wrong", "words"),
    [
        ("constraints: [chief_collision,", "constraints: [chief_colision,", ["did you mean `chief_collision`?"]),
        ("collision_radius: 10 ", "collision_radius: 800 ", ["r_max 800", "collision_radius 800", "no position"]),
        ("max_distance: 800 ", "max_distance: 9 ", ["r_max 9", "collision_radius 10", "no position is safe"]),
    ],
)  # fmt: skip
def test_wrong_parameters_are_reported_of_the_glue_and_of_the_sampler(copied, right, wrong, words):
    text, _ = problem_of(copied, "parameters.yml", right, wrong, wrong)
    first = "constraints" if "colision" in wrong else "max_d"  # the newest of the values that the message names
    whole = (copied / "parameters.yml").read_text()
    number = whole[: whole.index(first)].count("\n") + 1
    place = f"configs/translational-inspection/parameters.yml:{number} "
    shown = [line for line in text.splitlines() if line.removeprefix("error: ").startswith(place)]
    if "colision" in wrong:
        assert len(shown) == 1, "one mistake in one line is reported once"
    else:
        assert "simulator_reset_parameters.init_state" in text
        shown = [line for line in shown if "agent_config[0].config.config.glues[0].config" in line]
        assert len(shown) == 1, text
    for word in words:
        assert word in shown[0]


@pytest.mark.usefixtures("own_constraint")
@pytest.mark.parametrize(("method", "good"), [("backup", False), ("continuous", True)])
def test_a_constraint_that_the_backup_cannot_keep_is_refused_at_once(copied, method, good):
    agent, parameters = copied / "agent-seed.yml", copied / "parameters.yml"
    text = agent.read_text()
    assert OFF_LINE in text
    agent.write_text(text.replace(OFF_LINE, f"          enabled: True\n          method: {method}\n", 1))
    parameters.write_text(parameters.read_text().replace("[chief_collision,", "[OwnConstraint, chief_collision,", 1))
    if good:
        spec = load_experiment("configs/translational-inspection/experiment-seed.yml").spec
        assert "OwnConstraint" in spec.agents[0].action_glues[0].constraints
        return
    with pytest.raises(ConfigError, match=r"parameters\.yml:\d+ .*backup filter cannot enforce 'OwnConstraint'"):
        load_experiment("configs/translational-inspection/experiment-seed.yml")


@pytest.mark.usefixtures("own_constraint")
def test_a_constraint_upon_which_no_thrust_acts_is_refused_at_once(copied):
    """The filter would let it be broken without a single intervention."""
    agent, parameters = copied / "agent-seed.yml", copied / "parameters.yml"
    parameters.write_text(parameters.read_text().replace("[chief_collision,", "[Slab, chief_collision,", 1))
    load_experiment("configs/translational-inspection/experiment-seed.yml")  # it may still refuse initial states
    text = agent.read_text()
    agent.write_text(text.replace(OFF_LINE, "          enabled: True\n          method: continuous\n", 1))
    with pytest.raises(
        ConfigError, match=r"agent-seed\.yml:\d+ .*cannot enforce the constraint 'Slab': the velocity part"
    ):
        load_experiment("configs/translational-inspection/experiment-seed.yml")


_WEAK = "agent_config.blue0_ctrl.config.config.parts.0.config.properties={name: x_thrust, low: -0.5, high: 0.7}"
_SAMPLER = "config.config.env_config.simulator_reset_parameters.init_state.config.rta"
_REWARD = "agent_config.blue0_ctrl.config.config.reference_store.mass=20"


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (
            [f"{GLUE}.m=12", "platform_config.blue0.config.config.mass=20"],
            "glues[0].config.m: `m` is 12 here, but the platform's `mass` is 20",
        ),
        ([f"{GLUE}.n=0.001"], "`n` is 0.001 here, but the simulator's `mean_motion` is 0.001027"),
        ([f"{GLUE}.step_size=5"], "`step_size` is 5 here, but 1 / `frame_rate` is 10"),
        ([f"{_SAMPLER}.config={{m: 11 kg}}"], "init_state.config.rta.config.m: `m` is 11 here"),
        ([f"{GLUE}.u_max=1", _WEAK], "glues[0].config.u_max: the filter assumes 1 N along each axis"),
    ],
)
def test_a_filter_that_knows_another_spacecraft_is_refused(overrides, words):
    """A wrong mass or thrust would void the promise of the filter in silence."""
    with pytest.raises(ConfigError) as caught:
        load_experiment(configs_root() / "translational-inspection/experiment-seed.yml", [ON, *overrides])
    assert words in str(caught.value)


def glues_of(spec):
    """Return the agent's glue and the one of the sampler."""
    return spec.agents[0].action_glues[0], spec.reset.parameters["init_state"].rta.glue


def test_what_is_not_given_is_taken_from_the_world(shipped):
    heavy = ["platform_config.blue0.config.config.mass=20", _REWARD]
    world = "config.config.env_config.simulator.config"
    orbit = [f"{world}.mean_motion=0.0011", f"{world}.illumination_params.mean_motion=0.0011", f"{GLUE}.n=null"]
    spec = load_experiment(shipped, [ON, _WEAK, *heavy, *orbit, f"{GLUE}.u_max=null"]).spec
    for glue in glues_of(spec):
        assert (glue.step_size, glue.n, glue.m) == (10.0, 0.0011, 20.0)
    assert [glue.u_max for glue in glues_of(spec)] == [0.5, 1.0]  # the thrust of a filter that is enabled
    env = BatchedEnvironment(spec, 4, seed=SEED)
    env.reset()
    for thrust in random_thrusts(5, 4):
        transition = env.step(thrust)
        assert np.abs(transition.step.control).max() <= 0.5


def test_the_teams_filter_takes_what_all_deputies_have():
    shipped = configs_root() / "multiagent-translational-inspection/experiment.yml"
    weak = _WEAK.replace("blue0", "blue#")
    team = load_experiment(shipped, [weak]).spec.team_safety
    assert (team.u_max, team.m, team.n, team.step_size) == (0.5, 12.0, 0.001027, 10.0)
    worlds = [{"m": 12.0, "n": 0.001, "u_max": 1.0}, {"m": 20.0, "n": 0.001, "u_max": 0.5}]
    assert common_world(worlds) == {"n": 0.001, "u_max": 0.5}


def test_values_of_the_world_that_a_filter_cannot_work_with_are_reported():
    heavy = ["platform_config.blue0.config.config.mass=20000", _REWARD.replace("20", "20000")]
    experiment = configs_root() / "translational-inspection/experiment-seed.yml"
    load_experiment(experiment, heavy)  # without a filter a deputy may be as heavy as it likes
    slow = [ON, "agent_config.blue0_ctrl.config.config.frame_rate=0.001"]
    with pytest.raises(ConfigError, match=r"glues\[0\]\.config.*with the values of the simulation: .*too long a part"):
        load_experiment(experiment, slow)


def test_a_configuration_that_gives_everything_by_reference_loads_as_before(copied, shipped):
    """The blocks that other packages' files have: every field by reference, the world's own values among them."""
    plain = glues_of(load_experiment(shipped).spec)
    agent, environment = copied / "agent-seed.yml", copied / "environment.yml"
    references = {"n": "mean_motion", "m": "mass", "step_size": "step_size", "v0_distance": "collision_radius"}
    for path in (agent, environment):
        lines = "".join(f"{' ' * 10}{field}: {key}\n" for field, key in references.items())
        first = f"{' ' * 10}collision_radius: collision_radius\n"
        text = path.read_text()
        assert first in text
        path.write_text(text.replace(first, first + lines, 1))
    found = glues_of(load_experiment("configs/translational-inspection/experiment-seed.yml").spec)
    for one, other in zip(found, plain, strict=True):
        assert {**one.model_dump(), "v0_distance": None} == other.model_dump()
        assert one.v0_distance == other.collision_radius


def test_a_task_without_a_sun():
    states = {"position": np.array([[50.0, 0.0, 0.0]]), "velocity": np.array([[0.1, 0.0, 0.0]])}
    parameters = {"v0": 0.2, "v0_distance": 0.5, "collision_radius": 0.5}
    glue = RTAGlueCWHInspection1v1(constraints=("rel_vel", "x_vel"), **parameters)
    found = glue.safety(states)
    assert found["rel_vel"][0] == pytest.approx(0.2 + 2 * 0.001027 * 49.5 - 0.1, rel=1e-12)
    assert not any(refused[0] for refused in glue.refusals(states).values())
    with pytest.raises(PluginValueError, match="the task has no sun"):
        RTAGlueCWHInspection1v1(constraints=("rel_vel", "sun"), **parameters).safety(states)


UNSAFE = {
    "inside the radius": ((8.0, 0.0, 0.0), (0.0, 0.0, 0.0), "chief_collision"),
    "too fast": ((60.0, 0.0, 0.0), (0.0, 0.0, 0.5), "rel_vel"),
    "no plan": ((10.3, 0.0, 0.0), (-0.19, 0.0, 0.0), "recoverable"),
}


@pytest.mark.parametrize(("position", "velocity", "shown"), UNSAFE.values(), ids=UNSAFE.keys())
def test_fixed_initial_states_that_the_filter_cannot_keep_are_reported_at_the_reset(
    fixed_start, position, velocity, shown
):
    env = BatchedEnvironment(fixed_start(position, velocity, 0.0, overrides=(ON,)), 2, seed=SEED)
    with pytest.warns(
        UnsafeInitialStateWarning, match=rf"blue0: initial states are rejected by .*{shown}.*RejectionSampler"
    ):
        env.reset()


def test_safe_fixed_initial_states_and_those_of_a_sampler_are_not(fixed_start, spec_with):
    start = ((0.0, 60.0, 10.0), (0.01, 0.0, 0.0), 0.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        BatchedEnvironment(fixed_start(*start, overrides=(ON,)), 2, seed=SEED).reset()
        BatchedEnvironment(spec_with(ON), 20, seed=SEED).reset()
        BatchedEnvironment(fixed_start((8.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0), 2, seed=SEED).reset()  # no filter


def test_only_certifying_methods_state_what_they_keep():
    assert RTAGlueCWHInspection1v1(method="continuous").kept == {}
    assert {"chief_collision", "PSM", "sun"} <= set(RTAGlueCWHInspection1v1(method="backup").kept)
