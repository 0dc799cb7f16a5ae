"""What an import loads: validating a configuration waits neither for Ray nor for a compiler."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

_HEAVY = ("ray", "torch", "numba", "scipy", "sklearn", "matplotlib", "tensorboard", "pytest")


def loaded_by(statement: str) -> set[str]:
    """Return the heavy packages that a statement loads in a fresh interpreter."""
    code = f"{statement}\nimport json, sys\nprint(json.dumps(sorted({{name.split('.')[0] for name in sys.modules}})))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    return set(json.loads(done.stdout.splitlines()[-1])) & set(_HEAVY)


@pytest.mark.parametrize(
    "statement",
    [
        "import safe_inspect",
        "import safe_inspect.config.experiment",
        "import safe_inspect.cli.main",
        "from safe_inspect.plugins.registry import registry; assert registry.kinds()",
        "import safe_inspect.environments.registration as r; r.load_spec('safe_inspect/TranslationalInspection-v1')",
    ],
)
def test_reading_a_configuration_loads_nothing_heavy(statement: str) -> None:
    assert loaded_by(statement) == set()


@pytest.mark.parametrize(
    "statement",
    [
        "import safe_inspect.testing",
        "import safe_inspect; safe_inspect.make('safe_inspect/TranslationalInspectionSeed-v0').reset()",
        "import safe_inspect.train_rl",
    ],
)
def test_an_environment_needs_neither_ray_nor_torch(statement: str) -> None:
    assert not loaded_by(statement) & {"ray", "torch", "sklearn", "pytest", "matplotlib"}


def test_the_helper_sees_what_is_loaded() -> None:
    assert loaded_by("import scipy.special") >= {"scipy"}
