"""The source distribution and the wheel contain what the package needs, and work in a separate environment."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

_ROOT = Path(__file__).parents[2]
_BUILD = (
    "import sys; from setuptools import build_meta; print(getattr(build_meta, 'build_' + sys.argv[1])(sys.argv[2]))"
)


def _run(*command: str | Path, cwd: Path) -> str:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [str(word) for word in command],
        capture_output=True,
        text=True,
        timeout=300,
        cwd=cwd,
        env=environment,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Build the source distribution of the files that git knows, and the wheel of what it unpacks to."""
    setuptools = pytest.importorskip("setuptools")
    if int(setuptools.__version__.split(".")[0]) < 77:
        pytest.skip("pyproject.toml asks for setuptools 77")
    folder = tmp_path_factory.mktemp("distribution")
    source = folder / "source"
    for name in _run("git", "ls-files", "-z", cwd=_ROOT).split("\0"):
        if name and (_ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(_ROOT / name, source / name)
    sdist = folder / _run(sys.executable, "-c", _BUILD, "sdist", folder, cwd=source).split()[-1]
    with tarfile.open(sdist) as archive:
        archive.extractall(folder / "unpacked", filter="data")
    (unpacked,) = (folder / "unpacked").iterdir()
    return sdist, folder / _run(sys.executable, "-c", _BUILD, "wheel", folder, cwd=unpacked).split()[-1]


@pytest.mark.slow
def test_the_source_distribution_has_everything_that_the_readme_points_to(built: tuple[Path, Path]) -> None:
    with tarfile.open(built[0]) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    links = re.findall(r"\]\(([^)#:]+)[^):]*\)", (_ROOT / "README.md").read_text(encoding="utf-8"))
    assert len(links) > 30
    assert {link for link in links if link not in names} == set()
    assert {"scripts/demo.sh", "scripts/test.sh", "constraints.txt", "tests/conftest.py"} <= names


@pytest.mark.slow
def test_the_wheel_of_the_source_distribution_holds_every_file_of_the_package(built: tuple[Path, Path]) -> None:
    names = set(zipfile.ZipFile(built[1]).namelist())
    wanted = set()
    for name in _run("git", "ls-files", "safe_inspect", "configs", cwd=_ROOT).splitlines():
        if (_ROOT / name).is_file():
            wanted.add(re.sub(r"^configs/", "safe_inspect/configs/", name))
    assert wanted <= names, sorted(wanted - names)
    assert {name.split("/")[0] for name in names} == {
        "safe_inspect",
        built[1].name.rpartition("-py3")[0] + ".dist-info",
    }


@pytest.mark.slow
def test_the_installed_wheel_works_outside_of_the_repository(built: tuple[Path, Path], tmp_path: Path) -> None:
    pytest.importorskip("pip")
    _run(sys.executable, "-m", "venv", "--without-pip", "fresh", cwd=tmp_path)
    scripts = tmp_path / "fresh" / ("Scripts" if os.name == "nt" else "bin")
    (site,) = (tmp_path / "fresh").glob("**/site-packages")
    # The dependencies are those of this interpreter: their installation takes minutes and is setup.sh's.
    shared = [path for path in sys.path if path.endswith("site-packages")]
    (site / "shared.pth").write_text("\n".join(shared) + "\n")
    options = ("--no-deps", "--no-index", "--quiet", "--disable-pip-version-check")
    _run(sys.executable, "-m", "pip", "--python", scripts / "python", "install", *options, built[1], cwd=tmp_path)

    where = _run(scripts / "python", "-c", "import safe_inspect; print(safe_inspect.__file__)", cwd=tmp_path)
    assert Path(where.strip()).is_relative_to(site)
    command = scripts / "safe-inspect"
    assert "evaluate" in _run(command, "--help", cwd=tmp_path)
    assert "is valid" in _run(command, "validate", "configs/translational-inspection/experiment.yml", cwd=tmp_path)
    assert "docking  (trained" in _run(command, "list", "policies", cwd=tmp_path)
    assert "safe_inspect/Docking-v0" in _run(command, "list", "tasks", cwd=tmp_path)
