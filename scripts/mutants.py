"""Plant random faults in the package, one at a time, and count how many the tests notice.

    python scripts/mutants.py --seed 7 --count 300 --output mutants.jsonl
    python scripts/mutants.py --seed 7 --count 100 --rooms rta evaluation/results --output mutants.jsonl --jobs 2
    python scripts/mutants.py --output mutants.jsonl --table

A line of code is drawn uniformly from those of the rooms, a kind of fault from those that the line allows, and one
fault of that kind. It is planted in a copy of the repository, and the quick tests of the room that the file belongs
to are run there (`TESTS`). A fault that they do not notice survives; tests of other rooms do not count, because a
test should fail near the fault. Each result is appended to the output file at once: a run that was interrupted
continues where it stopped.

Faults that change nothing that a user could see are listed by hand in ``scripts/equivalent_mutants.txt``, one key a
line, with the reason behind ``#``; the table shows the score with and without them. This is own code instead of
cosmic-ray or mutmut because neither draws by lines of code, and neither replaces cached machine code together with
its kernel.
"""

from __future__ import annotations

import argparse
import json
import os
import random
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

from measures import PACKAGE, ROOT, importers, modules
from mutations import Mutation, mutations
from scipy.stats import binomtest

from safe_inspect.compiling.folders import digest_of, installed_folder

EQUIVALENT = ROOT / "scripts" / "equivalent_mutants.txt"
#: Folders of tests where their name is not that of the room; files at the top of the package are the room "ground".
TESTS = {
    "compiling": ["ground"], "config": ["config", "configs"], "evaluation": ["evaluation", "reference"],
    "plugins": ["ground", "contract"], "random": ["ground"],
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
_QUICK = "not slow and not long"


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

    def run(self, tests: tuple[str, ...], module: str, limit: float) -> tuple[str, float, str]:
        """Run quick tests, those that name the module first.

        Args:
            tests: Folders and files of tests.
            module: Name of the module in which a fault is planted.
            limit: When to stop [s].

        Returns:
            "passed", "failed" or "timeout"; how long it took [s]; and the first test that failed.
        """
        places = [self._root / place for place in tests]
        files = [
            path for place in places for path in ([place] if place.is_file() else sorted(place.rglob("test_*.py")))
        ]
        files.sort(key=lambda path: (module not in path.read_text(encoding="utf-8"), path.parent.name == "golden"))
        names = [path.relative_to(self._root).as_posix() for path in files]
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-p", "no:randomly"]
        environment = {
            **os.environ, "PYTHONPATH": str(self._root), "PYTHONDONTWRITEBYTECODE": "1", "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
        }  # fmt: skip
        before = time.monotonic()
        with tempfile.TemporaryFile("w+", encoding="utf-8") as output:
            process = subprocess.Popen(
                [*command, "-m", _QUICK, *names], cwd=self._root, env=environment, stdout=output,
                stderr=subprocess.STDOUT, start_new_session=True,
            )  # fmt: skip
            try:
                code = process.wait(limit)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, 9)
                process.wait()
                return "timeout", time.monotonic() - before, ""
            output.seek(0)
            text = output.read()
        failed = [line for line in text.splitlines() if line.startswith(("FAILED", "ERROR"))]
        return "passed" if code in (0, 5) else "failed", time.monotonic() - before, (failed or [text[-300:]])[0][:200]

    def planted(
        self, file: str, mutation: Mutation, tests: tuple[str, ...], limit: float
    ) -> tuple[str, float, str]:  # fmt: skip
        """Plant a fault, run tests, and take the fault out again; returns what `run` does."""
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
            return self.run(tests, module, limit)
        finally:
            path.write_text(source, encoding="utf-8")
            os.utime(path, (times.st_atime, times.st_mtime))
            if after:
                shutil.rmtree(after, ignore_errors=True)

    def _machine_code(self) -> Path:
        """Return the folder for machine code of the sources as they are."""
        package = self._root / "safe_inspect"
        return installed_folder(digest_of.__wrapped__(package), package)


def link_machine_code(before: Path, after: Path, changed: set[str]) -> None:
    """Keep the machine code of files that do not reach a changed module."""
    left_out = {tuple(name.split(".")[-2:]) for name in changed}
    for path in before.rglob("*.*"):
        folder, stem = path.parent.name.rpartition("_")[0], path.name.split(".")[0]
        if path.is_file() and (folder, stem) not in left_out:
            (after / path.relative_to(before)).parent.mkdir(parents=True, exist_ok=True)
            os.link(path, after / path.relative_to(before))


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
    lock = threading.Lock()
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        spaces = [Workspace(Path(folder) / str(number)) for number in range(options.jobs)]

        def measure(tests: tuple[str, ...]) -> float:
            with lock:
                space = spaces.pop()
            outcome, seconds, failed = space.run(tests, "", 3600.0)
            with lock:
                spaces.append(space)
            print(f"{', '.join(tests)}: {seconds:.0f} s without a fault", flush=True)
            if outcome != "passed":
                sys.exit(f"{', '.join(tests)}: the quick tests fail without a fault: {failed}")
            return 4.0 * seconds + 240.0

        sets = sorted({tests_of(room) for room in rooms})
        with ThreadPoolExecutor(options.jobs) as pool:
            limits = dict(zip(sets, pool.map(measure, sets), strict=True))

        def attempt(one: tuple[str, Mutation]) -> None:
            file, mutation = one
            room = room_of(file.removesuffix(".py").replace("/", "."))
            with lock:
                space = spaces.pop()
            outcome, seconds, test = space.planted(file, mutation, tests_of(room), limits[tests_of(room)])
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

        with ThreadPoolExecutor(options.jobs) as pool:
            list(pool.map(attempt, waiting))


if __name__ == "__main__":
    main()
