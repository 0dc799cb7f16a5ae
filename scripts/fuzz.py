"""Edit what users hand to the package at random, and check that each edit is accepted or refused with one message.

    python scripts/fuzz.py --seed 3 --count 2000
    python scripts/fuzz.py --seed 3 --count 100000 --jobs 2 --doors experiment override
    python scripts/fuzz.py --seed 3 --only 1234

Each attempt draws a door (see `DOORS`), takes what is valid there, edits one to three places of it, and goes through.
A finding is an exception that is not a `SafeInspectError`, a traceback, an exit code other than 0 and 2, a process
that dies, an attempt that takes longer than `_PATIENCE`, a message of more than `_LONGEST` characters, or a file that
appears outside the attempt's folder. An attempt is a function of the seed and its number, and `--only` repeats one.
Exit code: 0 without findings, else 1.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import FrameType

ROOT = Path(__file__).parents[1]
#: Seconds after which an attempt is a hang; kernels are compiled before the first.
_PATIENCE = 60
#: Characters of the longest message that a person would read.
_LONGEST = 20_000
_VALUES = [
    "", "null", "yes", "1e999", "-1", "0", "nan", ".inf", "[]", "{}", "[1, 2", "!include x.yml", "!remove", "&a *a",
    "0600", "1:30", "2026-01-01", "true", "x" * 5000, "10 parsecs", "5 m", "-3 m/s", "\u0000", "\u00e9\u4e16", "'",
    '"', ": :", "- - -", "{functor: x}", "os.system", "../../etc/passwd", "1_000", "99999999999999999999", "%", "@",
    "\t", "<<: *x", "~",
]  # fmt: skip


class Hang(BaseException):
    """An attempt takes too long."""


class Unedited(random.Random):
    """Draws for an attempt that leaves files as they are, which its door has to accept."""


def edited(numbers: random.Random, data: bytes) -> bytes:
    """Return bytes with one edit at a random place: of bits, of spans, or of the text's lines and values."""
    kind, at = numbers.randrange(9), numbers.randrange(len(data) + 1)
    span = data[at : at + numbers.choice([1, 2, 8, 64, 512])]
    if kind == 0 and at < len(data):
        return data[:at] + bytes([data[at] ^ 1 << numbers.randrange(8)]) + data[at + 1 :]
    if kind == 1:
        return data[:at] + data[at + len(span) :]
    if kind == 2:
        return data[:at] + span * numbers.choice([2, 3, 50]) + data[at + len(span) :]
    if kind == 3:
        return data[:at]
    if kind == 4:
        return data[:at] + numbers.choice(_VALUES).encode() + data[at:]
    lines = data.split(b"\n")
    line, other = numbers.randrange(len(lines)), numbers.randrange(len(lines))
    if kind == 5:
        lines[line], lines[other] = lines[other], lines[line]
    elif kind == 6:
        del lines[line]
    elif kind == 7:
        lines[line] = b" " * numbers.randrange(8) + lines[line].strip()
    else:
        words = re.split(rb"([\s,:={}\[\]]+)", lines[line])
        words[numbers.randrange(len(words))] = numbers.choice(_VALUES).encode()
        lines[line] = b"".join(words)
    return b"\n".join(lines)


def edit_file(numbers: random.Random, path: Path) -> None:
    """Edit one to three places of a file."""
    if isinstance(numbers, Unedited):
        return
    data = path.read_bytes()
    for _ in range(numbers.choice([1, 1, 2, 3])):
        data = edited(numbers, data)
    path.write_bytes(data)


def command(*words: str) -> str:
    """Run a command of ``safe-inspect`` in this process; return its message where it refuses, else nothing."""
    from safe_inspect.cli.main import main

    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = main(list(words))
        except SystemExit as stop:
            code = stop.code if isinstance(stop.code, int) else 2
    assert code in (0, 2), f"exit code {code}: {err.getvalue()[-500:]}"
    assert code == 0 or err.getvalue().strip(), "exit code 2 without a message"
    return err.getvalue() if code or "Traceback" in err.getvalue() else ""


def _experiments(root: Path) -> list[Path]:
    return sorted(path for path in root.rglob("experiment*.yml") if "peer" not in path.name)


def _included(path: Path) -> list[Path]:
    """Return a file and all that it includes."""
    found, waiting = [], [path]
    while waiting:
        file = waiting.pop()
        if file.is_file() and file not in found:
            found.append(file)
            names = re.findall(r"!include\s+(\S+)", file.read_text(encoding="utf-8"))
            waiting += [(file.parent / name).resolve() for name in names]
    return found


def experiment(numbers: random.Random, folder: Path) -> str:
    """Validate an experiment of which one file is edited."""
    shutil.copytree(ROOT / "configs", folder / "configs")
    chosen = numbers.choice(_experiments(folder / "configs"))
    edit_file(numbers, numbers.choice(_included(chosen)))
    return command("validate", str(chosen))


def override(numbers: random.Random, folder: Path) -> str:
    """Validate a shipped experiment with an edited override."""
    chosen = numbers.choice(_experiments(ROOT / "configs"))
    keys = re.findall(r"^\s*(?:- )?(\w+):", "\n".join(p.read_text() for p in _included(chosen)), re.MULTILINE)
    path = ".".join(numbers.choice(keys) for _ in range(numbers.choice([1, 1, 2, 3])))
    text = f"{path}={numbers.choice([*_VALUES, '3', '0.5', '7 s', '[1, 2]'])}"
    if numbers.random() < 0.5:
        text = edited(numbers, text.encode()).decode(errors="replace").replace("\0", "")
    return command("validate", str(chosen), text) if not text.startswith("-") else ""


def _policy_folder(numbers: random.Random, folder: Path) -> Path:
    source = numbers.choice(sorted(path.parent for path in ROOT.glob("safe_inspect/policies/trained/*/policy.json")))
    shutil.copytree(source, folder / "policy")
    return folder / "policy"


def checkpoint(numbers: random.Random, folder: Path) -> str:
    """Load a trained policy of which one file is edited, and ask it for an action."""
    policy = _policy_folder(numbers, folder) / "checkpoint"
    names = [file.stem for file in sorted(policy.parent.glob("*.onnx"))]
    edit_file(numbers, numbers.choice(sorted(path for path in policy.rglob("*") if path.is_file())))
    return _loaded(policy, names[0] if len(names) > 1 else None)


def onnx(numbers: random.Random, folder: Path) -> str:
    """Load an edited ONNX policy, and ask it for an action."""
    policy = numbers.choice(sorted(_policy_folder(numbers, folder).glob("*.onnx")))
    edit_file(numbers, policy)
    return _loaded(policy)


def _loaded(path: Path, name: str | None = None) -> str:
    import numpy as np

    from safe_inspect.environments.layout import observation_layout
    from safe_inspect.errors import SafeInspectError
    from safe_inspect.experiments.modules.sources import load_policy

    try:
        policy = load_policy(str(path), agent=name)
        agent = next(agent for agent in policy.spec.agents if agent.name == policy.agent)
        policy.predict(np.zeros(observation_layout(agent).size, dtype=np.float32), episode_start=True)
    except SafeInspectError as error:
        return str(error) or "Traceback: an error without a message"
    return ""


def evaluation(numbers: random.Random, folder: Path) -> str:
    """Compare an evaluation with itself when one of its files is edited, or draw a flight of it."""
    shutil.copytree(_sample("evaluation"), folder / "flown")
    edit_file(numbers, numbers.choice(sorted((folder / "flown").rglob("*.*"))))
    if numbers.random() < 0.5:
        return command("compare", str(folder / "flown"), str(_sample("evaluation")))
    return command("view", str(folder / "flown"), "--output", str(folder / "page.html"))


def curve(numbers: random.Random, folder: Path) -> str:
    """Read an edited table of progress."""
    rows = ["iteration,steps,return_mean,success_rate,inspected_fraction,delta_v"]
    rows += [f"{k},{1000 * k},{0.1 * k},{0.05 * k},{1 / k},{k}" for k in range(1, 12)]
    (folder / "progress.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    edit_file(numbers, folder / "progress.csv")
    return command("curves", str(folder / "progress.csv"), "--output", str(folder / "curve.png"))


def log(numbers: random.Random, folder: Path) -> str:
    """Read a sensor log of which one file is edited."""
    from safe_inspect.errors import SafeInspectError
    from safe_inspect.missions.sensor_log import read_sensor_log

    shutil.copytree(_sample("log"), folder / "log")
    edit_file(numbers, numbers.choice(sorted(path for path in (folder / "log").rglob("*.*") if path.is_file())))
    try:
        read = read_sensor_log(folder / "log")
        for index in range(len(read.times)):
            read.frame(index)
    except SafeInspectError as error:
        return str(error)
    return ""


DOORS: dict[str, tuple[Callable[[random.Random, Path], str], int]] = {
    "experiment": (experiment, 50), "override": (override, 25), "checkpoint": (checkpoint, 6), "onnx": (onnx, 6),
    "evaluation": (evaluation, 6), "curve": (curve, 2), "log": (log, 5),
}  # fmt: skip


def _sample(name: str) -> Path:
    return Path(os.environ["FUZZ_SAMPLES"]) / name


def make_samples(folder: Path) -> None:
    """Write the evaluation and the sensor log that attempts copy and edit."""
    experiments = ROOT / "configs"
    task = str(experiments / "translational-inspection" / "experiment-seed.yml")
    flown = ["evaluate", "zero-thrust", "--cfg", task, "--episodes", "2", "--record", "1"]
    command(*flown, "--output", str(folder / "evaluation"))
    target = str(experiments / "tumbling-rendezvous" / "experiment-truth.yml")
    command("record-log", target, "--output", str(folder / "log"), "--seconds", "3")


def attempt(seed: int, number: int, doors: list[str]) -> dict[str, str] | None:
    """Make one attempt; return the finding, or None.

    Args:
        seed: Seed of the run.
        number: Number of the attempt.
        doors: The doors to draw from.
    """
    numbers = random.Random(f"{seed}-{number}")
    door = numbers.choices(doors, [DOORS[name][1] for name in doors])[0]
    with tempfile.TemporaryDirectory(prefix="fuzz-") as place:
        folder, outside = Path(place) / "attempt", Path(place) / "cwd"
        folder.mkdir()
        outside.mkdir()
        os.chdir(outside)
        signal.signal(signal.SIGALRM, _hang)
        signal.alarm(_PATIENCE)
        problem = ""
        try:
            message = DOORS[door][0](numbers, folder)
            if "Traceback" in message:
                problem = f"a traceback: {message[-600:]}"
            elif len(message) > _LONGEST:
                problem = f"a message of {len(message)} characters: {message[:200]}"
        except Hang:
            problem = f"no end after {_PATIENCE} s: {traceback.format_exc()[-600:]}"
        except Exception:  # every exception is a finding
            problem = traceback.format_exc()[-900:]
        finally:
            signal.alarm(0)
            os.chdir(ROOT)
        if not problem and any(outside.iterdir()):
            problem = f"files outside: {[path.name for path in outside.iterdir()]}"
    return {"attempt": str(number), "door": door, "problem": problem} if problem else None


def _hang(number: int, frame: FrameType | None) -> None:
    raise Hang


def _work(options: argparse.Namespace) -> None:
    """Make attempts in this process; a line before each and one for each finding go to standard output."""
    stream = os.fdopen(os.dup(1), "w", encoding="utf-8")
    for number in range(options.first, options.first + options.count):
        print(json.dumps({"begins": number}), file=stream, flush=True)
        finding = attempt(options.seed, number, options.doors)
        if finding:
            print(json.dumps(finding), file=stream, flush=True)


def _run(options: argparse.Namespace, first: int, count: int) -> list[dict[str, str]]:
    """Make attempts in a separate process, and in a new one after each process that dies."""
    findings: list[dict[str, str]] = []
    while count > 0:
        words = ["--seed", str(options.seed), "--first", str(first), "--count", str(count), "--doors", *options.doors]
        process = subprocess.run(
            [sys.executable, __file__, *words, "--work"], capture_output=True, text=True, errors="replace",
            check=False,
        )  # fmt: skip
        last = first
        for line in process.stdout.splitlines():
            with contextlib.suppress(ValueError):
                record = json.loads(line)
                if "begins" in record:
                    last = record["begins"]
                elif "problem" in record:
                    findings.append(record)
        if process.returncode == 0:
            break
        died = f"the process has died ({process.returncode}): {process.stderr[-600:]}"
        findings.append({"attempt": str(last), "door": "", "problem": died})
        first, count = last + 1, count - (last + 1 - first)
    return findings


def main() -> int:
    """Make the attempts and print the findings."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first attempt")
    parser.add_argument("--count", type=int, default=2000, help="number of attempts")
    parser.add_argument("--only", type=int, help="make this attempt alone, in this process")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--doors", nargs="*", default=list(DOORS), choices=list(DOORS))
    parser.add_argument("--work", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.work:
        _work(options)
        return 0
    with tempfile.TemporaryDirectory(prefix="fuzz-samples-") as samples:
        os.environ["FUZZ_SAMPLES"] = samples
        make_samples(Path(samples))
        for door in set(options.doors) - {"override"}:
            with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
                message = DOORS[door][0](Unedited(options.seed), Path(folder))
                if message:
                    sys.exit(f"the door {door} refuses what is not edited: {message}")
        if options.only is not None:
            print(attempt(options.seed, options.only, options.doors))
            return 0
        chunk = min(max(options.count // (4 * options.jobs), 1), 500)
        last = options.first + options.count
        chunks = [(first, min(chunk, last - first)) for first in range(options.first, last, chunk)]
        findings: list[dict[str, str]] = []
        with ThreadPoolExecutor(options.jobs) as pool:
            for done, found in enumerate(pool.map(lambda one: _run(options, *one), chunks), 1):
                findings += found
                for finding in found:
                    print(f"{finding['attempt']} {finding['door']}: {finding['problem']}\n", flush=True)
                print(f"{min(done * chunk, options.count)} attempts, {len(findings)} findings", flush=True)
    print(dict(Counter(finding["door"] for finding in findings)))
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
