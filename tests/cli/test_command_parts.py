"""What commands pass on, print and return, with the work that they call replaced."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydantic_core import PydanticUndefined

from safe_inspect.cli.commands import export, rendezvous, safety, warm
from safe_inspect.cli.commands import list as catalogue
from safe_inspect.config.data import configs_root
from safe_inspect.errors import Problem
from safe_inspect.plugins.registry import registry
from safe_inspect.rendezvous.coordination.context import Phase
from safe_inspect.rta.constraints.sets import NAMES

EXPERIMENT = str(configs_root() / "translational-inspection" / "experiment.yml")
MISSION = str(configs_root() / "tumbling-rendezvous" / "experiment-truth.yml")


Typed = Callable[..., tuple[int, str, str]]

pytestmark = pytest.mark.usefixtures("here")


def context(time: float, problem: str = "") -> Any:
    errors = SimpleNamespace(attitude=np.radians(1.25), rate=np.radians(0.5))
    estimate = SimpleNamespace(relative=np.array([3.0, 4.0, 12.0, 9.0, 9.0, 9.0]), problem=problem, errors=errors)
    return SimpleNamespace(time=time, phase=Phase.OBSERVE, estimate=estimate)


def test_a_mission_shows_how_it_stands_from_time_to_time(capsys: pytest.CaptureFixture[str]) -> None:
    lines = rendezvous._MissionLines()
    for time in (0.0, 0.5, 1.5, 2.0, 3.0, 10.5, 12.0, 20.0, 21.0):
        lines.step(context(time))
    lines.change(2.0, Phase.OBSERVE, "seen", Phase.PLAN)
    lines.step(context(99.0, "nothing is seen"))
    state = "OBSERVE, 13.00 m from the target's centre; attitude within 1.2 deg, rate within 0.5 deg/s"
    assert capsys.readouterr().err.splitlines() == [
        *(f"{time:8.1f} s  {state}" for time in (0.0, 10.5, 21.0)),
        "     2.0 s  OBSERVE -> PLAN (seen)",
        "    99.0 s  OBSERVE, 13.00 m from the target's centre; nothing is seen",
    ]


@pytest.mark.parametrize(("success", "code"), [(True, 0), (False, 1)])
def test_a_mission_is_flown_and_its_log_written(
    typed: Typed, monkeypatch: pytest.MonkeyPatch, here: Path, success: bool, code: int
) -> None:
    given: list[Any] = []

    class Log:
        def write(self, folder: Path, text: str, summary: Any) -> None:
            (folder / "log").write_text(text)
            given.append(summary)

    class Mission:
        def __init__(self, config: Any, episode: int, *_: Any) -> None:
            given.append((config.seed, episode))

        def run(self) -> Any:
            return SimpleNamespace(summary={"success": success}, log=Log())

    monkeypatch.setattr(rendezvous, "Mission", Mission)
    monkeypatch.setattr(rendezvous, "mission_table", lambda summary: f"the table of {summary}")
    monkeypatch.setattr(rendezvous, "check_scenario", lambda experiment, count=1: [Problem(f"doubt of {count}")])
    words = ("rendezvous", MISSION, "seed=5", "--episode", "3")
    found, out, err = typed(*words, "--output", "o")
    assert (found, out) == (code, f"the table of {{'success': {success}}}\nthe log is in o\n")
    assert err.splitlines()[1:] == ["warning: doubt of 4"]
    assert given == [(5, 3), {"success": success}]
    assert "EnvisatTarget" in (here / "o" / "log").read_text()
    assert typed(*words)[1] == f"the table of {{'success': {success}}}\n"
    assert len(given) == 3  # no log was written


def test_warming_calls_all_kernels_and_says_how_long_it_took(typed: Typed, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []

    class Environment:
        def __init__(self, spec: Any, count: int, seed: int) -> None:
            calls.append((spec.agents[0].name, count, seed))
            self.acting = [SimpleNamespace(size=2, action_layout=SimpleNamespace(size=3))]

        def reset(self, rows: Any = None) -> None:
            calls.append(("reset", None if rows is None else rows.tolist()))

        def step(self, actions: Any) -> None:
            calls.append(("step", [action.shape for action in actions], any(action.any() for action in actions)))

    now, compiled = iter([1.0, 4.5, 10.0, 10.25]), iter([0.5, 2.5, 3.0, 3.0])
    monkeypatch.setattr(warm, "TeamEnvironment", Environment)
    monkeypatch.setattr(warm, "kept_in", lambda: Path("kept"))
    monkeypatch.setattr(warm, "time", SimpleNamespace(monotonic=lambda: next(now)))
    monkeypatch.setattr(warm, "compiling_seconds", lambda: next(compiled))
    assert typed("warm", EXPERIMENT, "safe_inspect/Docking-v0")[:2] == (
        0,
        f"[1/2] {EXPERIMENT} 3.5 s, 2.0 s of it compiling\n"
        "[2/2] safe_inspect/Docking-v0 0.2 s, 0.0 s of it compiling\n"
        "the machine code is in kept\n",
    )
    assert calls == [("blue0_ctrl", 1, 0), ("reset", None), ("step", [(1, 2, 3)], False), ("reset", [0])] * 2


@pytest.mark.parametrize(("violations", "code"), [(0, 0), (1, 1)])
@pytest.mark.parametrize(
    ("words", "enabled"),
    [((), True), (("--off",), False), (("--off", "RTAGlueCWHInspection1v1.config.enabled=True"), False)],
)
def test_the_exit_code_of_a_safety_report(
    typed: Typed, monkeypatch: pytest.MonkeyPatch, violations: int, code: int, words: tuple[str, ...], enabled: bool
) -> None:
    given: list[Any] = []

    class Report(SimpleNamespace):
        def __str__(self) -> str:
            return "the report"

    def report(spec: Any, *numbers: Any, progress: Any) -> Report:
        given.append((spec.agents[0].action_glues[0].enabled, *numbers))
        return Report(violations=violations)

    monkeypatch.setattr(safety, "safety_report", report)
    assert typed("safety", EXPERIMENT, "--steps", "9", "--num-envs", "3", "--seed", "5", *words)[:2] == (
        code,
        "the report\n",
    )
    assert given == [(enabled, 9, 3, 5)]


CEILING = """
from safe_inspect.rta.constraints import Constraint, ConstraintValues


class CeilingOfAudit(Constraint):
    def evaluate(self, state):
        out = ConstraintValues.zeros(len(state))
        out.phi[:] = out.h[:] = 500.0 - state.position[:, 2]
        out.gradient[:, 2], out.gradient[:, 5] = -1.0, -1.0
        return out

    @staticmethod
    def half_space(p, x, d):
        d[2] = -1.0
        return -500.0
"""


@pytest.mark.parametrize(("violations", "infeasible", "code"), [(0, 0, 0), (1, 0, 1), (0, 1, 1)])
def test_the_exit_code_of_an_audit(
    typed: Typed, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, violations: int, infeasible: int, code: int
) -> None:
    given: list[Any] = []

    class Found(SimpleNamespace):
        def __str__(self) -> str:
            return "the audit"

    def audit(count: int, *, seed: int, first: Any, progress: Any) -> Found:
        given.append((count, seed, type(first).__name__))
        least = dict.fromkeys(NAMES, 1.0)
        found = Found(settings=1234, steps=5678, infeasible=infeasible, violations=violations, least=least)
        progress(found)
        return found

    monkeypatch.setattr(safety, "audit", audit)
    assert typed("safety", EXPERIMENT, "--audit", "1999", "--seed", "7") == (
        code,
        "the audit\n",
        f"1,234 of 2,000 settings, 5,678 steps, {infeasible} without a plan, {violations} violations\n",
    )
    assert given[0][:2] == (1999, 7)
    (tmp_path / "ceiling.py").write_text(CEILING)
    monkeypatch.syspath_prepend(tmp_path)
    own = "reference_store.constraints+=[ceiling.CeilingOfAudit]"
    assert typed("safety", EXPERIMENT, "--audit", "1999", "--seed", "7", own)[2].splitlines()[-1] == (
        "note: CeilingOfAudit not audited, because the audit only has independent definitions of the built-in "
        "constraints; run `safe-inspect safety` without --audit to test it"
    )
    docking = str(configs_root() / "docking" / "experiment.yml")
    code, _, err = typed("safety", docking, "--audit", "3")
    words = "the audit supports only RTAGlueCWHInspection1v1 with the method 'backup'"
    assert (code, err) == (2, f"error: {docking}: {words}\n")


@pytest.mark.ray
@pytest.mark.parametrize(
    ("words", "names", "asked", "output"),
    [
        ((), ["default_policy"], "default_policy", "policy.onnx"),
        ((), ["red"], "red", "red.onnx"),
        (("--policy", "blue", "--output", "b.onnx"), ["red", "blue"], "blue", "b.onnx"),
        ((), ["red", "blue"], None, "error: c: the checkpoint has the policies red, blue; name one with --policy\n"),
    ],
)
def test_what_an_export_writes_and_says(
    typed: Typed,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    names: list[str],
    asked: str | None,
    output: str,
) -> None:
    from safe_inspect.experiments import export as work

    given: list[Any] = []

    def write(checkpoint: Path, target: Path, policy: str, experiment: Any) -> Any:
        given.append((checkpoint, target, policy, experiment))
        info = SimpleNamespace(
            task="T", policy=policy, agents=("a", "b"), observation=[1, 2, 3], action=[1], distribution="gaussian"
        )
        difference = SimpleNamespace(action=1.25e-7, rows=6000)
        return SimpleNamespace(path=target, info=info, difference=difference, flown=1000)

    monkeypatch.setattr(export, "newest_checkpoint", lambda path: Path("c"))
    monkeypatch.setattr(export, "policy_names", lambda checkpoint: names)
    monkeypatch.setattr(work, "export_policy", write)
    code, out, err = typed("export", "run", *words)
    if asked is None:
        assert (code, err) == (2, output)
        return
    assert given == [(Path("c"), Path(output), asked, None)]
    assert (code, out) == (
        0,
        f"{output}: T, policy {asked}, for a, b\n"
        "  3 readings in SI units to 1 commands, the means of the policy\n"
        "  largest difference from the checkpoint: 1.2e-07 of the action's range, over 5,000 random and 1,000 flown "
        "observations\n",
    )


def test_a_plugin_is_listed_with_defaults_units_and_meaning() -> None:
    cls = registry.get("reward", "WinLoseDoneReward")
    first, *fields = catalogue._block("WinLoseDoneReward", cls, nested=True).splitlines()
    assert first.startswith("  WinLoseDoneReward  ")
    assert len(fields) == len(cls.model_fields)
    assert catalogue._default(SimpleNamespace(default_factory=None, default=PydanticUndefined)) == "required"
    for default, text in ((0.5, "0.5"), ("x" * 58, repr("x" * 58)), ("x" * 59, f"'{'x' * 56}...")):
        assert catalogue._default(SimpleNamespace(default_factory=None, default=default)) == text
    assert catalogue._default(SimpleNamespace(default_factory=dict, default=None)) == "{}"


def test_the_list_of_tasks_says_who_makes_them() -> None:
    blocks = [
        block.splitlines() for block in catalogue._tasks().replace("\nsafe_inspect/", "\n\nsafe_inspect/").split("\n\n")
    ]
    made = {lines[0].partition("  ")[0]: lines[0].partition("  ")[2] for lines in blocks}
    assert made["safe_inspect/Docking-v0"] == "(gymnasium.make)"
    assert made["safe_inspect/MultiagentDocking-v0"] == "(several agents: safe_inspect.make_parallel)"
    (docking,) = [lines for lines in blocks if lines[0].startswith("safe_inspect/Docking-v0 ")]
    about = "Docking: a deputy flies to a chief at rest, the slower the nearer it comes"
    assert docking[1:] == ["    configs/docking/experiment.yml", f"    {about}"]
