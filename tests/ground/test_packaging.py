from __future__ import annotations

import configparser
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from safe_inspect.evaluation import shipped
from safe_inspect.version import __version__

ROOT = Path(__file__).parents[2]
NOT_DATA = {".py", ".pyc", ".nbc", ".nbi"}  # modules, and what Python and Numba make of them


@pytest.fixture
def setup() -> configparser.ConfigParser:
    parser = configparser.ConfigParser()
    parser.read(ROOT / "setup.cfg")
    return parser


def packages() -> dict[str, Path]:
    """Return the folder of each package."""
    folders = (path.parent for path in ROOT.glob("safe_inspect/**/__init__.py"))
    found = {".".join(folder.relative_to(ROOT).parts): folder for folder in folders}
    return found | {"safe_inspect.configs": ROOT / "configs"}


def data_files() -> Iterator[Path]:
    """Yield every file of the packages that is no module."""
    for folder in (ROOT / "safe_inspect", ROOT / "configs"):
        for path in folder.rglob("*"):
            if path.is_file() and path.suffix not in NOT_DATA and "__pycache__" not in path.parts:
                yield path


def test_every_package_is_installed(setup: configparser.ConfigParser) -> None:
    listed = setup["options"]["packages"].split()
    assert set(listed) == set(packages())
    assert len(listed) == len(set(listed))
    assert {"safe_inspect.figures", "safe_inspect.metrics", "safe_inspect.policies"} <= set(listed)


def test_every_data_file_is_installed(setup: configparser.ConfigParser) -> None:
    folders = packages()
    installed = {
        path
        for package, patterns in setup["options.package_data"].items()
        for pattern in patterns.split()
        for path in folders[package].glob(pattern)
    }
    wanted = set(data_files())
    assert {ROOT / "safe_inspect" / "figures" / f"page.{suffix}" for suffix in ("html", "css", "js")} <= wanted
    assert wanted - installed == set()


def test_the_trained_policies_would_be_installed_from_where_they_are_looked_for(
    setup: configparser.ConfigParser, tmp_path: Path
) -> None:
    policies = packages()["safe_inspect.policies"]
    place = shipped._ROOT.relative_to(policies) / "some-policy"
    files = [tmp_path / place / name for name in ("policy.onnx", "card.md", "runs/0/progress.csv")]
    for file in files:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    patterns = setup["options.package_data"]["safe_inspect.policies"].split()
    assert set(files) <= {path for pattern in patterns for path in tmp_path.glob(pattern)}


def test_no_data_file_runs_code_when_it_is_loaded() -> None:
    found = {path.suffix for path in data_files()}
    assert ".safetensors" in found
    assert not found & {".pkl", ".pickle", ".pt", ".pth", ".npy", ".npz"}


@pytest.mark.slow
def test_a_wheel_of_the_sdist_works_outside_the_repository(tmp_path: Path) -> None:
    source, built, site = (tmp_path / name for name in ("source", "built", "site"))
    left_out = shutil.ignore_patterns(".*", "__pycache__", "output", "tests", "benchmarks", "*.egg-info", "build")
    shutil.copytree(ROOT, source, ignore=left_out)
    code = "import sys; from setuptools import build_meta; print(getattr(build_meta, sys.argv[1])(sys.argv[2]))"

    def run(*words: str, cwd: Path) -> str:
        paths = {**os.environ, "PYTHONPATH": str(site)}
        done = subprocess.run([sys.executable, *words], capture_output=True, text=True, timeout=170, cwd=cwd, env=paths)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    sdist = run("-c", code, "build_sdist", str(built), cwd=source).splitlines()[-1]
    with tarfile.open(built / sdist) as archive:
        archive.extractall(tmp_path / "unpacked", filter="data")
    (unpacked,) = (tmp_path / "unpacked").iterdir()
    wheel = run("-c", code, "build_wheel", str(built), cwd=unpacked).splitlines()[-1]
    with zipfile.ZipFile(built / wheel) as archive:
        archive.extractall(site)
    assert str(site) in run("-c", "import safe_inspect; print(safe_inspect.__file__)", cwd=tmp_path)
    assert "is valid: PPO" in run("-m", "safe_inspect", "validate", "safe_inspect/Docking-v0", cwd=tmp_path)
    assert "translational-inspection  (trained" in run("-m", "safe_inspect", "list", "policies", cwd=tmp_path)
    load = "import safe_inspect; print(safe_inspect.load_policy('docking').agent)"
    assert run("-c", load, cwd=tmp_path).split() == ["blue0_ctrl"]


def test_the_citation_names_the_version() -> None:
    assert f"\nversion: {__version__}\n" in (ROOT / "CITATION.cff").read_text()
