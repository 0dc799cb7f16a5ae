"""The releases of Numba that are allowed end with the one that is tested."""

from __future__ import annotations

import configparser
import re
from importlib.metadata import version
from pathlib import Path

from packaging.requirements import Requirement
from packaging.version import Version

ROOT = Path(__file__).parents[2]
REMEDY = (
    "run all tests and `python benchmarks/suite.py --quick --compare benchmarks/reference.json` with it; where they "
    "pass, write it in constraints.txt and the minor release after it as the upper bound in setup.cfg; where they "
    "fail, fix what calls Numba, which is safe_inspect/compiling"
)


def allowed() -> Requirement:
    settings = configparser.ConfigParser()
    settings.read(ROOT / "setup.cfg", encoding="utf-8")
    lines = settings["options"]["install_requires"].split()
    return next(Requirement(line) for line in lines if line.startswith("numba"))


def test_the_upper_bound_is_the_minor_release_after_the_tested_one() -> None:
    pinned = re.search(r"^numba==(.*)$", (ROOT / "constraints.txt").read_text(encoding="utf-8"), re.MULTILINE)
    assert pinned is not None
    tested = Version(pinned[1])
    (bound,) = (each.version for each in allowed().specifier if each.operator == "<")
    assert bound == f"{tested.major}.{tested.minor + 1}", f"Numba {tested} is tested in constraints.txt: {REMEDY}"


def test_the_installed_release_is_allowed() -> None:
    installed = version("numba")
    assert installed in allowed().specifier, f"Numba {installed} is outside of `{allowed()}` in setup.cfg: {REMEDY}"
