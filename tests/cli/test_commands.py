"""The commands as a user types them: what they print, their exit codes, and no traceback for a mistake."""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from safe_inspect import train_rl
from safe_inspect.cli import flight_arguments
from safe_inspect.cli.main import main
from safe_inspect.config.spec import PolicySpec
from safe_inspect.evaluation.shipped import shipped_policies
from safe_inspect.plugins.registry import registry
from safe_inspect.task_ids import ALL_TASKS
from safe_inspect.version import __version__

EXPERIMENT = "configs/translational-inspection/experiment-seed.yml"
SHIPPED = "configs/translational-inspection/experiment.yml"
REWARDS = ("InspectionCrashReward", "InspectionDeltaVReward", "InspectionRTAReward", "ObservedPointsReward")
OBSERVATION = (
    "Sensor_Position.x",
    "Sensor_Position.y",
    "Sensor_Position.z",
    "Sensor_Velocity.v_x",
    "Sensor_Velocity.v_y",
    "Sensor_Velocity.v_z",
    "Sensor_InspectedPoints.n_inspected",
    "Sensor_UninspectedPoints.x_ups",
    "Sensor_UninspectedPoints.y_ups",
    "Sensor_UninspectedPoints.z_ups",
    "Sensor_SunAngle.theta_sun",
)


@pytest.fixture(autouse=True)
def here(shipped: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Copy the shipped folder below a working directory of the test's own."""
    shutil.copytree(shipped.parent, tmp_path / "configs" / "translational-inspection")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))  # the command puts the working directory on it
    return tmp_path


@pytest.fixture
def typed(capsys):
    """Return a function that runs a command: exit code, standard output, standard error."""

    def run(*words, command=main):
        try:
            code = command([str(word) for word in words])
        except SystemExit as stop:  # argparse
            code = stop.code
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return code, captured.out, captured.err

    return run


def shell(*words: str) -> subprocess.CompletedProcess[str]:
    script = Path(sys.executable).with_name("safe-inspect")
    return subprocess.run([str(script), *words], capture_output=True, text=True, timeout=120, check=False)


def spoil(file: str, right: str, wrong: str) -> int:
    path = Path("configs/translational-inspection") / file
    text = path.read_text()
    assert right in text
    path.write_text(text.replace(right, wrong, 1))
    return path.read_text().partition(wrong)[0].count("\n") + 1


def test_the_installed_command_states_its_version():
    done = shell("--version")
    assert done.returncode == 0
    assert done.stdout == f"safe_inspect {__version__}\n"


def test_the_installed_command_refuses_a_misspelt_key_without_a_traceback():
    line = spoil("agent.yml", "scale: 0.01", "scael: 0.01")
    done = shell("validate", EXPERIMENT)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith(f"error: configs/translational-inspection/agent.yml:{line} ")
    assert "did you mean `scale`?" in done.stderr
    assert "Traceback" not in done.stderr


def test_validating_the_shipped_experiment_is_quick():
    begun = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    done = shell("validate", EXPERIMENT)
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - begun < 3.0  # of the processor, 0.6 s as a rule
    assert done.returncode == 0
    assert done.stdout == f"{EXPERIMENT} is valid: PPO, blue0_ctrl on blue0\n"


def test_validating_loads_neither_ray_nor_torch():
    code = (
        "import sys; from safe_inspect.cli.main import main; "
        f"code = main(['validate', {EXPERIMENT!r}]); print(sorted({{'ray', 'torch'}} & set(sys.modules))); "
        "sys.exit(code)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0
    assert done.stdout.splitlines()[-1] == "[]"


def test_list_shows_every_kind(typed):
    code, out, _ = typed("list")
    assert code == 0
    for word in ("\nreward\n", "\ndone\n", "\nglue\n", "RTAGlueCWHInspection1v1", "\nconstraint\n", *REWARDS):
        assert word in f"\n{out}"


def test_list_of_a_kind_and_of_a_name(typed):
    code, out, _ = typed("list", "reward")
    assert code == 0
    assert out.startswith("reward\n")
    assert all(name in out for name in REWARDS)
    assert "CrashDoneFunction" not in out
    code, out, _ = typed("list", "reward", "InspectionRTAReward")
    assert code == 0
    assert "scale = -0.01  Reward for an intervention" in out
    assert "ObservedPointsReward" not in out
    code, out, _ = typed("list", "part", "Sensor_Position")
    assert "      errors = None" in out
    assert "          noise = 0.0  Standard deviation of the white noise." in out
    assert "noise = " not in typed("list", "part")[1]


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        (("rewrad",), ["unknown kind 'rewrad'", "did you mean `reward`?"]),
        (("reward", "InspectionRTARewrd"), ["'InspectionRTARewrd'", "did you mean `InspectionRTAReward`?"]),
        (("reward", "CrashDoneFunction"), ["unknown plugin 'CrashDoneFunction'"]),
        (("reward", "no_such_module.MyReward"), ["no module 'no_such_module'"]),
    ],
)
def test_list_of_what_is_not_there(typed, words, shown):
    code, out, err = typed("list", *words)
    assert code == 2
    assert out == ""
    assert all(word in err for word in shown)


def test_list_of_a_class_by_its_dotted_path(typed):
    by_path, by_name = (
        typed("list", "reward", "safe_inspect.rewards.inspection.ObservedPointsReward"),
        typed("list", "reward", "ObservedPointsReward"),
    )
    assert by_path[0] == 0
    assert by_path[1].splitlines()[2:] == by_name[1].splitlines()[2:]


@pytest.mark.parametrize(
    ("experiment", "words", "shown"),
    [
        (
            EXPERIMENT,
            ("algorithm=DQN",),
            "DQN supports only discrete actions, but these are real numbers; replace ControllerGlue",
        ),
        (
            SHIPPED,
            ("algorithm=SAC",),
            "SAC supports only continuous actions, but these are discrete, one level",
        ),
    ],
)
def test_an_algorithm_that_cannot_learn_the_actions_is_refused(typed, experiment, words, shown):
    code, out, err = typed("validate", experiment, *words)
    assert (code, out) == (2, "")
    assert shown in err


def test_a_policy_that_cannot_be_flown_is_reported_before_the_training(typed):
    code, _, err = typed("validate", EXPERIMENT, "use_lstm=True")
    assert code == 0
    assert "exported" not in err
    recurrent = "agent_config.0.policy={algorithm: DQN, config: {model_config: {use_lstm: True}}}"
    code, _, err = typed("validate", "configs/translational-inspection/experiment.yml", recurrent)
    assert code == 0
    assert "note: recurrent policies of DQN cannot be exported to ONNX" in err
    code, _, err = typed("validate", EXPERIMENT, "agent_config.0.policy={algorithm: SAC}")
    assert code == 0
    assert "policies" not in err


def test_validate_reports_all_mistakes_of_the_files(typed):
    first = spoil("agent.yml", "scale: 0.01", "scael: 0.01")
    second = spoil("environment.yml", "radius: 10 m", "radius: -10 m")
    code, out, err = typed("validate", EXPERIMENT)
    assert code == 2
    assert out == ""
    assert err.startswith("errors:\n")
    assert f"agent.yml:{first} " in err
    assert f"environment.yml:{second} " in err
    assert len(err.splitlines()) == 3


@pytest.mark.parametrize("file", ["configs/none.yml", "configs", ""])
def test_validate_of_what_is_no_file(typed, file):
    code, _, err = typed("validate", file)
    assert code == 2
    assert err.startswith("error: ")


@pytest.mark.parametrize("file", ["experiment", "environment", "agent", "task", "platform", "policy", "rendezvous"])
def test_the_schema_is_printed(typed, file):
    code, out, _ = typed("schema", file)
    assert code == 0
    schema = json.loads(out)
    assert "properties" in schema or "$ref" in schema or "anyOf" in schema
    assert typed("schema", file, "--output", "schema.json")[:2] == (0, "")
    assert json.loads(Path("schema.json").read_text()) == schema


def test_the_schema_of_nothing_or_into_nothing(typed):
    code, _, err = typed("schema", "agnet")
    assert code == 2
    assert "did you mean `agent`?" in err
    for target in ("configs/translational-inspection/task.yml/schema.json", "configs"):
        code, out, err = typed("schema", "--output", target)
        assert code == 2
        assert out == ""
        assert f"{target}: the file cannot be written" in err


@pytest.mark.parametrize(
    "words",
    [
        ("acceptance", EXPERIMENT, "rta.args.max_distance=60", "--draws", "50"),
        ("acceptance", EXPERIMENT, "--draws", "50", "rta.args.max_distance=60"),
        ("acceptance", "--draws", "50", EXPERIMENT, "rta.args.max_distance=60"),
        ("acceptance", EXPERIMENT, "seed=4", "--draws", "50", "rta.args.max_distance=60", "--seed", "0"),
    ],
)
def test_overrides_may_stand_before_and_after_options(typed, words):
    code, out, _ = typed(*words)
    assert code == 0
    first, _, *rows = out.splitlines()
    assert "of 50 draws are accepted" in first
    (line,) = [row for row in rows if row.startswith("r_max")]
    assert float(line.split()[1]) > 50.0  # of ranges from 50 to 100 m, most are above 60 m


@pytest.mark.parametrize("words", [("horizn=10",), ("--draws", "9", "horizn=10")])
def test_an_override_of_nothing_is_named(typed, words):
    code, _, err = typed("acceptance", EXPERIMENT, *words)
    assert code == 2
    assert "command line: horizn=10" in err
    assert "did you mean `horizon`?" in err


@pytest.mark.parametrize(
    "words",
    [
        ("validate", EXPERIMENT, "--nope"),
        ("validate", EXPERIMENT, "nope"),
        ("validate", EXPERIMENT, "--draws", "5"),
        ("list", "reward", "InspectionRTAReward", "a=b"),
        ("validate",),
        ("validat", EXPERIMENT),
        (),
    ],
)
def test_what_is_no_command_line_is_refused(typed, words):
    code, out, err = typed(*words)
    assert code == 2
    assert out == ""
    assert err.startswith("error: ")
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize(
    ("override", "shown"),
    [
        ("scheduler=ray.tune.schedulers.ASHA", "tune_config.scheduler: module 'ray.tune.schedulers' has no 'ASHA'"),
        ("scheduler=ray.tune.Callback", "tune_config.scheduler: 'ray.tune.Callback' is not a scheduler of ray.tune"),
        (
            "initial_weights=docking",
            "model_config.initial_weights: docking: its weights do not match this policy",
        ),
        (
            "initial_weights=dockin",
            "'dockin' is neither the folder of a checkpoint nor a policy that the package ships",
        ),
        ("fcnet_activation=gelu", "expected 'tanh', 'relu', 'swish', 'silu' or 'linear', got 'gelu'"),
    ],
)
def test_what_only_the_training_would_meet_is_found_by_validate(typed, override, shown):
    shipped = "configs/translational-inspection/experiment.yml"
    for words in (("validate", shipped), ("train", shipped, "--dry-run")):
        code, out, err = typed(*words, override)
        assert (code, out) == (2, "")
        assert shown in err
    assert typed("validate", shipped, "scheduler=ray.tune.schedulers.ASHAScheduler")[0] == 0


def test_policies_that_do_not_fit_their_agents_are_found_by_validate(typed, tmp_path):
    file = tmp_path / "team.yml"
    file.write_text(
        "- !include configs/multiagent-translational-inspection/experiment.yml\n"
        "- agent_config+:\n"
        "  - {name: red_ctrl, platforms: [red], config: !include configs/translational-inspection/agent.yml ,\n"
        "     policy: {checkpoint: nofolder}}\n"
        "  platform_config+: [{name: red, config: !include configs/translational-inspection/platform.yml }]\n"
    )
    for words in (("validate", file), ("train", file, "--dry-run")):
        code, out, err = typed(*map(str, words))
        assert (code, out) == (2, "")
        assert err == f"error: {file.name}:4 agent_config[1].policy.checkpoint: nofolder: there is no such checkpoint\n"


def test_a_checkpoint_that_does_not_fly_is_named(capsys):
    def candidate(policies):
        frozen = PolicySpec("old", ("red", "blue"), "", {}, checkpoint="here")
        trained = PolicySpec("new", ("green",), "PPO", {})
        experiment = SimpleNamespace(policies={"old": frozen, "new": trained})
        return SimpleNamespace(label="random", policies=policies, experiment=experiment)

    for policies, shown in (
        (print, True),
        ({"red": print, "green": print}, True),
        ({"red": print, "green": id}, False),
    ):
        flight_arguments._print_unused(candidate(policies))
        text = "flies every agent that is controlled from outside, so the `checkpoint` of red, blue is not used"
        assert capsys.readouterr().err == f"note: random {text}\n" * shown


def test_a_shipped_policy_is_exported_already(typed):
    code, _, err = typed("export", "docking")
    assert code == 2
    assert "docking is already shipped as ONNX; copy " in err
    assert "docking" in Path(err.split()[-1]).parts


def test_an_unknown_algorithm_lists_all_known_ones(typed):
    err = typed("validate", "configs/translational-inspection/experiment.yml", "algorithm=A3C")[2]
    assert "no algorithm of RLlib is called `A3C`; use one of `PPO`, `APPO`, `IMPALA`, `SAC`, `DQN`" in err


def test_a_misspelt_command_or_option_names_the_nearest(typed):
    for override in ("--override", "--overrides"):
        assert f"{override}; write only KEY=VALUE; see" in typed("evaluate", "zero-thrust", override, "horizon=10")[2]
    assert "--drows; did you mean `--draws`?" in typed("acceptance", EXPERIMENT, "--drows", "5")[2]
    assert "`list tasks` does not take a name; remove 'x'" in typed("list", "tasks", "x")[2]
    assert typed("evaluat")[2].startswith("error: there is no command 'evaluat'; did you mean `evaluate`?")


@pytest.mark.parametrize(
    "words",
    [
        ("validate", EXPERIMENT, "lr=1e-3"),
        ("validate", "lr=1e-3", "--cfg", EXPERIMENT),
        ("validate", "lr=1", EXPERIMENT),
    ],
)
def test_an_experiment_is_given_by_its_file_or_by_cfg(typed, words):
    assert typed(*words) == (0, f"{EXPERIMENT} is valid: PPO, blue0_ctrl on blue0\n", "")


def test_a_list_that_replaces_the_one_of_a_shipped_file_is_pointed_out(typed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = Path("own.yml")
    lines = "- !include configs/translational-inspection/experiment.yml\n- blue0_ctrl:\n"
    lines += "    rewards{0}: [{{functor: {1}}}]\n"
    lines += "    reference_store: {{constraints{0}: [{{functor: PSM}}]}}\n"
    file.write_text(lines.format("", "InspectionSuccessReward"))
    code, out, err = typed("validate", "own.yml")
    assert (code, out) == (0, "own.yml is valid: PPO, blue0_ctrl on blue0\n")
    rewards, constraints = sorted(err.splitlines())
    assert rewards.startswith("warning: own.yml:3 agent_config[0].config.config.rewards: this list replaces that of ")
    assert rewards.endswith("append with `rewards+: [...]`, or change an item by its name with `rewards: {NAME: ...}`")
    assert "own.yml:4 agent_config[0].config.config.reference_store.constraints: this list replaces" in constraints
    file.write_text(lines.format("+", "InspectionSuccessReward, name: Again").replace("[{functor: PSM}]", "[]"))
    assert typed("validate", "own.yml")[2] == ""
    assert typed("validate", "configs/weighted-translational-inspection/experiment.yml")[2] == ""


@pytest.mark.parametrize("command", ["validate", "safety", "acceptance", "rendezvous"])
def test_a_command_without_its_experiment_asks_for_it(typed, command):
    assert typed(command) == (2, "", "error: no experiment: give an experiment file; see `safe-inspect --help`\n")


def test_the_tasks_and_the_policies_are_listed(typed):
    code, out, _ = typed("list", "tasks")
    assert code == 0
    assert set(ALL_TASKS) == {line.split()[0] for line in out.splitlines() if line.startswith("safe_inspect/")}
    assert "    configs/docking/experiment.yml\n    Docking: a deputy flies to a chief at rest" in out
    code, out, _ = typed("list", "policies")
    assert code == 0
    assert all(f"--policy {name})\n    " in out for name in shipped_policies())
    assert "NaturalMotionInspector  (scripted, also inspector)\n    Inspect" in out


def test_a_name_that_the_terminal_cannot_show():
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    script = Path(sys.executable).with_name("safe-inspect")
    done = subprocess.run([script, "validate", "nöpe.yml"], capture_output=True, text=True, env=environment, timeout=60)
    assert done.returncode == 2
    assert done.stderr.startswith("error: no file 'n\\xf6pe.yml'")


def test_acceptance_prints_shares(typed):
    code, out, err = typed("acceptance", EXPERIMENT, "--draws", "50")
    assert code == 0
    assert "because the filter is off; set RTAGlueCWHInspection1v1.config.enabled=true" in err
    assert "of 50 draws are accepted" in out
    for name in ("chief_collision", "rel_vel", "sun", "r_max", "PSM", "x_vel", "y_vel", "z_vel"):
        assert f"\n{name} " in out


@pytest.mark.parametrize("experiment", [EXPERIMENT, SHIPPED], ids=["real thrust", "levels of thrust"])
def test_safety_enables_the_filter_and_finds_nothing(typed, experiment):
    code, out, _ = typed("safety", experiment, "--steps", "600", "--num-envs", "60", "--plot", "worst.png")
    assert code == 0
    assert out.startswith("600 filtered steps")
    assert "interventions, to the chief: 0.0 %" not in out
    assert Path("worst.png").stat().st_size > 1000


def test_safety_off_counts_violations_and_says_so_by_its_exit_code(typed):
    code, out, _ = typed("safety", EXPERIMENT, "--off", "--steps", "600", "--num-envs", "60")
    assert code == 1
    assert out.startswith("600 steps without the filter")
    assert "interventions" not in out
    assert "initial states that violate a constraint" in out


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        (("safety", "--steps", "0"), "--steps: expected a whole number of at least 1, not '0'"),
        (("safety", "--steps", "many"), "--steps: expected a whole number of at least 1, not 'many'"),
        (("safety", "--num-envs", "-3"), "--num-envs: expected a whole number of at least 1"),
        (("acceptance", "--draws", "1.5"), "--draws: expected a whole number of at least 1"),
        (("safety", "--off", "--steps", "60", "--seed", "-1"), "--seed: expected a whole number from 0"),
        (("acceptance", "--draws", "5", "--seed", str(2**64)), "--seed: expected a whole number from 0"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(typed, words, shown):
    code, out, err = typed(words[0], EXPERIMENT, *words[1:])
    assert code == 2  # not 1, which means violations
    assert out == ""
    assert shown in err


def test_a_plot_that_cannot_be_written_is_a_mistake_of_the_users(typed):
    code, _, err = typed("safety", EXPERIMENT, "--steps", "50", "--plot", f"{EXPERIMENT}/drawn.png")
    assert code == 2
    assert "drawn.png" in err or EXPERIMENT in err


def test_a_dry_run_names_the_plugin_that_writes_into_the_state(typed, here, monkeypatch):
    lines = [
        "from safe_inspect.rewards import Reward",
        "class TeleportReward(Reward):",
        "    def __call__(self, step):",
        "        step.after.position[:] = 0",
        "        return step.after.time",
    ]
    (here / "teleport.py").write_text("\n".join(lines))
    monkeypatch.syspath_prepend(here)
    before = dict(registry.items("reward"))
    reward = "agent_config.0.config.config.rewards.1={functor: teleport.TeleportReward}"
    code, _, err = typed("--cfg", EXPERIMENT, "--dry-run", reward, command=train_rl.main)
    registry._classes["reward"] = before
    assert code == 2
    assert "the reward TeleportReward writes into an array that is read-only" in err
    assert "teleport.py:4: step.after.position[:] = 0)" in err
    assert "Traceback" not in err


def test_a_dry_run_of_levels_draws_levels(typed):
    code, out, err = typed("train", SHIPPED, "--dry-run", "horizon=30")
    assert (code, err) == (0, "")
    assert "one of 3" in out


@pytest.mark.parametrize("through", ["train_rl", "safe-inspect train"])
def test_a_dry_run_prints_the_layout(typed, through):
    words = ("--cfg", EXPERIMENT, "--dry-run", "horizon=30", "--output", "runs")
    code, out, _ = typed(*words, command=train_rl.main) if through == "train_rl" else typed("train", *words)
    assert code == 0
    names = out.partition("observation, 11 elements:\n")[2].splitlines()[:11]
    assert [line.split()[0] for line in names] == list(OBSERVATION)
    assert "action, 3 elements:" in out
    assert "one action for 10 s" in out
    assert "safety filter: none" in out
    assert not os.path.exists("runs")


def test_training_without_an_experiment_says_what_to_give(typed):
    code, out, err = typed(command=train_rl.main)
    assert (code, out) == (2, "")
    assert "--cfg" in err
    assert "--resume" in err


def test_training_with_an_unknown_option_or_experiment(typed):
    code, _, err = typed("--cfg", EXPERIMENT, "--dryrun", command=train_rl.main)
    assert code == 2
    assert "--dryrun" in err
    code, _, err = typed("--cfg", "configs/translational-inspection/experimnt.yml", "--dry-run", command=train_rl.main)
    assert code == 2
    assert "did you mean `configs/translational-inspection/experiment.yml`?" in err


_OWN = "agent_config.blue0_ctrl.config.config.glues.0.config"
_DISTURBED = "config.config.env_config.simulator.config.disturbance"


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        (
            ("configs/docking/experiment.yml", "RTAGlueCWHDocking3d.config.enabled=True"),
            "safety filter: RTAGlueCWHDocking3d",
        ),
        (
            ("configs/multiagent-translational-inspection/experiment.yml", "env_config.rta.config.enabled=True"),
            "safety filter of all agents: RTACWHInspectionTeam, keeps chief_collision, rel_vel, sun",
        ),
        (
            (SHIPPED, "RTAGlueCWHInspection1v1.config.enabled=True", f"{_OWN}.disturbance={{velocity: 0.2 mm/s}}"),
            "PSM, x_vel, y_vel, z_vel, under velocity 0.0002",
        ),
        (
            (
                SHIPPED,
                f"{_DISTURBED}={{functor: BoundedDisturbance, config: {{velocity: 0.1 mm/s, thrust_gain: 0.01}}}}",
            ),
            "disturbance: BoundedDisturbance, velocity 0.0001, thrust_gain 0.01",
        ),
    ],
)
def test_a_dry_run_says_which_filter_guards_whom(typed, words, shown):
    code, out, _ = typed("train", *words, "--dry-run", "horizon=30")
    assert code == 0
    assert shown in out
