"""Plant random faults in the package, one at a time, and count how many the tests notice.

    python scripts/mutants.py --seed 7 --count 300 --output mutants.jsonl
    python scripts/mutants.py --seed 7 --count 100 --rooms rta evaluation/results --output mutants.jsonl --jobs 2
    python scripts/mutants.py --output mutants.jsonl --table

A line of code is drawn uniformly from those of the rooms, a kind of fault from those that the line allows, and one
fault of that kind. It is planted in a copy of the repository, and the quick tests of the room that the file belongs
to are run there (`TESTS`), until one fails. A fault that they do not notice survives; tests of other rooms do not
count, because a test should fail near the fault. Each result is appended to the output file at once: a run that was
interrupted continues where it stopped.

First the tests are run once without a fault, and the functions that each test file runs are saved next to the output
(`.reach.json`). Files that run the function in which a fault is planted are tried first, and the others if none of
them notices it.

Faults that change nothing that a user could see are listed by hand in ``scripts/equivalent_mutants.txt``, one key a
line, with the reason behind ``#``; the table shows the score with and without them. This is own code instead of
cosmic-ray or mutmut because neither draws by lines of code, and neither replaces cached machine code together with
its kernel.
"""

from __future__ import annotations

import argparse
import ast
import functools
import hashlib
import itertools
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from forked_tests import functions_of
from measures import PACKAGE, ROOT, importers, modules
from mutations import Mutation, mutations
from scipy.stats import binomtest

from safe_inspect.compiling import folders as compiling
from safe_inspect.compiling.folders import installed_folder

EQUIVALENT = ROOT / "scripts" / "equivalent_mutants.txt"
#: Folders of tests where their name is not that of the room; files at the top of the package are the room "ground".
TESTS = {
    "compiling": ["ground"], "config": ["config", "configs"], "evaluation": ["evaluation", "reference"],
    "missions": ["rendezvous"], "plugins": ["ground", "contract"], "random": ["ground"],
    "simulators": ["simulators", "contract"], "tasks": ["tasks", "platforms"], "testing": ["contract"],
    "train_rl": ["experiments"],
}  # fmt: skip
#: The rooms whose every number the recorded flights hold.
RECORDED = {
    "dones", "dynamics", "environments", "geometry", "glues", "metrics", "platforms", "policies", "random", "rewards",
    "rta", "simulators", "tasks",
}  # fmt: skip
#: The folders on which every result rests; the table shows their score together.
CORE = ("rta", "dynamics", "simulators", "tasks", "evaluation/results")
#: What files of tests say that start processes, whose functions are not measured.
_PROCESSES = re.compile(r"subprocess|multiprocessing|Popen|\bray\b|Async|num_workers")


def sources() -> list[Path]:
    """Return the source files of the package; what is generated next to machine code does not count."""
    return sorted(path for path in PACKAGE.rglob("*.py") if "__pycache__" not in path.parts)


def room_of(module: str) -> str:
    """Return the room of a module: the folder below the package, or "ground" for files at its top."""
    parts = module.split(".")
    return parts[1] if len(parts) > 2 or parts[-1] in TESTS else "ground"


def is_in(file: str, rooms: Iterable[str]) -> bool:
    """Say whether a file, relative to the repository, is in one of some rooms or folders below the package."""
    in_folder = any(file.startswith(f"safe_inspect/{room}/") for room in rooms)
    return in_folder or room_of(file.removesuffix(".py").replace("/", ".")) in rooms


def tests_of(room: str) -> tuple[str, ...]:
    """Return the folders, and files, of the tests that a room names."""
    recorded = "golden" if room in RECORDED else "golden/test_options.py"
    return tuple(f"tests/{name}" for name in (*TESTS.get(room, [room]), recorded))


def draw(seed: int, count: int, rooms: list[str]) -> list[tuple[str, Mutation]]:
    """Return faults, each with its file relative to the repository, without repetition.

    Args:
        seed: Seed of the draws.
        count: How many.
        rooms: The rooms, or folders of the package, to draw from; empty for all.
    """
    numbers = random.Random(seed)
    lines = defaultdict(list)
    for path in sources():
        name = path.relative_to(ROOT).as_posix()
        if not rooms or is_in(name, rooms):
            for mutation in mutations(path.read_text(encoding="utf-8")):
                lines[name, mutation.line].append(mutation)
    places, drawn = list(lines), []
    while len(drawn) < count and places:
        place = places.pop(numbers.randrange(len(places)))
        source = (ROOT / place[0]).read_text(encoding="utf-8")
        kinds = sorted({mutation.kind for mutation in lines[place]})
        while kinds:
            kind = kinds.pop(numbers.randrange(len(kinds)))
            mutation = numbers.choice([mutation for mutation in lines[place] if mutation.kind == kind])
            if mutation.compiles(source):
                drawn.append((place[0], mutation))
                break
    return drawn


def key_of(file: str, mutation: Mutation) -> str:
    """Return a text that names a fault: file, line, what is replaced, by what."""
    before = mutation.replaced((ROOT / file).read_text(encoding="utf-8"))
    return f"{file}:{mutation.line} {' '.join(before.split())[:80]!r} -> {' '.join(mutation.text.split())[:80]!r}"


class Workspace:
    """A copy of the repository in which faults are planted.

    Args:
        folder: Where the copy is made.
    """

    def __init__(self, folder: Path) -> None:
        self._root = folder
        listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True)
        for name in filter(None, listed.stdout.split("\0")):
            if (ROOT / name).is_file():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, folder / name)
        self._faults = 0
        environment = {
            **os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1", "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
        }  # fmt: skip
        self._server = subprocess.Popen(
            [sys.executable, str(ROOT / "scripts" / "forked_tests.py")], cwd=folder, env=environment, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip

    def close(self) -> None:
        """Stop the process that runs the tests."""
        self._server.communicate()

    def run(self, files: list[str], limit: float, reach: Path | None = None) -> tuple[str, float, str]:
        """Run quick tests.

        Args:
            files: Files of tests, in the order in which they are run.
            limit: When to stop [s].
            reach: The file to write to which functions each file of tests runs; None to measure nothing.

        Returns:
            "passed", "failed" or "timeout"; how long it took [s]; and the first test that failed.
        """
        if not files:
            return "passed", 0.0, ""
        before = time.monotonic()
        output = self._root / "output-of-tests"
        request = {"names": files, "output": str(output), "limit": limit, "reach": str(reach) if reach else None}
        assert self._server.stdin is not None
        assert self._server.stdout is not None
        self._server.stdin.write(json.dumps(request) + "\n")
        self._server.stdin.flush()
        code = json.loads(self._server.stdout.readline())
        seconds = time.monotonic() - before
        if code == "timeout":
            return "timeout", seconds, ""
        text = output.read_text(encoding="utf-8", errors="replace")
        failed = [line for line in text.splitlines() if line.startswith(("FAILED", "ERROR"))]
        return "passed" if code in (0, 5) else "failed", seconds, (failed or [text[-300:]])[0][:200]

    def planted(self, file: str, mutation: Mutation, tests: list[str], limit: float) -> tuple[str, float, str]:
        """Plant a fault, run files of tests, and take the fault out again; returns what `run` does."""
        path, module = self._root / file, file.removesuffix(".py").replace("/", ".").removesuffix(".__init__")
        source, times = path.read_text(encoding="utf-8"), path.stat()
        before, after = self._machine_code(), None
        self._faults += 1
        try:
            path.write_text(mutation.applied(source), encoding="utf-8")
            os.utime(path, (times.st_atime, times.st_mtime + 1000 * self._faults))
            if "@njit" in source:
                after = self._machine_code()
                link_machine_code(before, after, importers(module, modules()))
            return self.run(tests, limit)
        finally:
            path.write_text(source, encoding="utf-8")
            os.utime(path, (times.st_atime, times.st_mtime))
            if after:
                shutil.rmtree(after, ignore_errors=True)

    def _machine_code(self) -> Path:
        """Return the folder for machine code of the sources as they are."""
        package = self._root / "safe_inspect"
        return installed_folder(compiling.digest_of.__wrapped__(package), package)


def link_machine_code(before: Path, after: Path, changed: set[str]) -> None:
    """Keep the machine code of files that do not reach a changed module; kernels of tests are compiled again."""
    left_out = {tuple(name.split(".")[-2:]) for name in changed}
    left_out |= {(path.parent.name, path.stem) for path in (ROOT / "tests").rglob("*.py")}
    for path in before.rglob("*.*"):
        folder, stem = path.parent.name.rpartition("_")[0], path.name.split(".")[0]
        if path.is_file() and (folder, stem) not in left_out:
            (after / path.relative_to(before)).parent.mkdir(parents=True, exist_ok=True)
            os.link(path, after / path.relative_to(before))


class Reach:
    """Which files of tests can notice a fault: those that run the function in which it is planted.

    A fault outside functions, or in compiled ones, can be noticed by every file; a file that starts processes can
    notice every fault, and so can a file that was edited since it was measured.

    Args:
        path: Where the measurements are kept.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._known: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}

    def unknown(self, tests: tuple[str, ...]) -> list[str]:
        """Return the files of some folders of tests that have to be measured."""
        return [file for file in files_of(tests) if self._known.get(file, {}).get("digest") != digest_of(file)]

    def measure(self, files: list[str], space: Workspace) -> None:
        """Run files of tests without a fault, and keep which functions they run."""
        if not files:
            return
        with tempfile.TemporaryDirectory() as folder:
            record = Path(folder) / "reach.json"
            outcome, seconds, failed = space.run(files, 3600.0, record)
            if outcome != "passed":
                sys.exit(f"the quick tests fail without a fault: {failed}")
            measured = json.loads(record.read_text(encoding="utf-8"))
        nothing: dict[str, Any] = {"seconds": 0.0, "functions": {}}
        shared = measured.pop("", nothing)["functions"]
        for file in files:
            known = measured.get(file, nothing)
            for module, starts in shared.items():
                known["functions"][module] = sorted({*starts, *known["functions"].get(module, [])})
            self._known[file] = {**known, "digest": digest_of(file)}
        self._path.write_text(json.dumps(self._known), encoding="utf-8")
        print(f"{len(files)} files of tests: {seconds:.0f} s without a fault", flush=True)

    def seconds(self, files: list[str]) -> float:
        """Return how long files of tests take without a fault [s]."""
        return float(sum(self._known[file]["seconds"] for file in files))

    def files(self, module: str, mutation: Mutation, tests: tuple[str, ...]) -> list[str]:
        """Return the files that can notice a fault: what names the module first, then what takes least."""
        source = (ROOT / module).read_text(encoding="utf-8")
        start = functions_of(source).get(mutation.line)
        everyone = start is None or _is_compiled(source, start)
        found, name = [], module.removesuffix(".py").replace("/", ".").removesuffix(".__init__")
        for file in files_of(tests):
            text = (ROOT / file).read_text(encoding="utf-8")
            if everyone or _PROCESSES.search(text) or start in self._known[file]["functions"].get(module, []):
                found.append((name not in text, "golden" in file, self._known[file]["seconds"], file))
        return [file for *_, file in sorted(found)]


def _is_compiled(source: str, line: int) -> bool:
    """Say whether the function whose ``def`` is in a line, or one around it, is compiled."""
    return any(
        isinstance(node, ast.FunctionDef)
        and node.lineno <= line <= (node.end_lineno or 0)
        and any("njit" in ast.unparse(decorator) for decorator in node.decorator_list)
        for node in ast.walk(ast.parse(source))
    )


@functools.cache
def digest_of(file: str) -> str:
    """Return a digest of a file of the repository."""
    return hashlib.sha256((ROOT / file).read_bytes()).hexdigest()


@functools.cache
def files_of(tests: tuple[str, ...]) -> list[str]:
    """Return the files of some folders and files of tests."""
    places = [ROOT / place for place in tests]
    files = [path for place in places for path in ([place] if place.is_file() else sorted(place.rglob("test_*.py")))]
    return [path.relative_to(ROOT).as_posix() for path in files]


def table(results: list[dict[str, Any]]) -> str:
    """Return the scores by room: faults, those that were noticed, share with its 95 % interval, equivalent ones.

    The row "core" holds the folders `CORE`.
    """
    equivalent = set()
    if EQUIVALENT.is_file():
        lines = EQUIVALENT.read_text(encoding="utf-8").splitlines()
        equivalent = {line.split("#")[0].strip() for line in lines} - {""}
    rooms = defaultdict(list)
    for result in results:
        rooms[result["room"]].append(result)
    rows = [f"{'room':14} faults noticed    raw   95 % interval equivalent  score"]
    core = [result for result in results if is_in(result["key"].split(":")[0], CORE)]
    for room, group in [*sorted(rooms.items()), ("core", core), ("all", results)]:
        if not group:
            continue
        count, noticed = len(group), sum(result["outcome"] != "passed" for result in group)
        same = sum(result["outcome"] == "passed" and result["key"] in equivalent for result in group)
        interval = binomtest(noticed, count).proportion_ci(method="wilson")
        score = noticed / (count - same) if count > same else 1.0
        shares = f"{noticed / count:6.1%}  {interval.low:6.1%} {interval.high:6.1%}"
        rows.append(f"{room:14} {count:6} {noticed:7} {shares:>22} {same:10} {score:6.1%}")
    return "\n".join(rows)


def main() -> None:
    """Plant faults and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--rooms", nargs="*", default=[], help="rooms or folders to draw from; without it, all")
    parser.add_argument("--jobs", type=int, default=1, help="faults that are tried at the same time")
    parser.add_argument("--output", type=Path, required=True, help="file of results, one JSON object a line")
    parser.add_argument("--table", action="store_true", help="print the table of the output file, and plant nothing")
    options = parser.parse_args()
    results = []
    if options.output.is_file():
        results = [json.loads(line) for line in options.output.read_text(encoding="utf-8").splitlines()]
    if not options.table:
        _plant_all(options, results)
    for result in results:
        if result["outcome"] == "passed":
            print("survived", result["kind"] + ":", result["key"])
    if results:
        print(table(results))


def _plant_all(options: argparse.Namespace, results: list[dict[str, Any]]) -> None:
    done = {result["key"] for result in results}
    waiting = [one for one in draw(options.seed, options.count, options.rooms) if key_of(*one) not in done]
    rooms = sorted({room_of(file.removesuffix(".py").replace("/", ".")) for file, _ in waiting})
    lock, reach = threading.Lock(), Reach(options.output.with_suffix(".reach.json"))
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        spaces = [Workspace(Path(folder) / str(number)) for number in range(options.jobs)]
        unknown = sorted({file for room in rooms for file in reach.unknown(tests_of(room))})
        shares: list[list[str]] = [[] for _ in spaces]
        for _, group in itertools.groupby(unknown, key=lambda file: file.split("/")[1]):
            min(shares, key=len).extend(group)
        with ThreadPoolExecutor(options.jobs) as pool:
            list(pool.map(reach.measure, shares, spaces))

        def attempt(one: tuple[str, Mutation]) -> None:
            file, mutation = one
            room = room_of(file.removesuffix(".py").replace("/", "."))
            tests = reach.files(file, mutation, tests_of(room))
            with lock:
                space = spaces.pop()
            limit = 3.0 * reach.seconds(tests) + (240.0 if "@njit" in (ROOT / file).read_text("utf-8") else 60.0)
            outcome, seconds, test = space.planted(file, mutation, tests, limit)
            rest = sorted({*files_of(tests_of(room))} - {*tests})
            if outcome == "passed" and rest:  # the measurement may miss what a file runs only if no other did before
                limit = 3.0 * reach.seconds(rest) + 240.0
                outcome, more, test = space.planted(file, mutation, rest, limit)
                seconds += more
            with lock:
                spaces.append(space)
                result = {
                    "key": key_of(file, mutation), "room": room, "kind": mutation.kind, "outcome": outcome,
                    "seconds": round(seconds, 1), "test": test,
                }  # fmt: skip
                results.append(result)
                with options.output.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(result) + "\n")
                print(f"{len(results):4d} {outcome:8} {seconds:6.1f} s  {result['key']}", flush=True)

        try:
            with ThreadPoolExecutor(options.jobs) as pool:
                list(pool.map(attempt, waiting))
        finally:
            for space in spaces:
                space.close()


if __name__ == "__main__":
    main()
