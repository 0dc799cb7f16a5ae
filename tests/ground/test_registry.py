from __future__ import annotations

import os
import subprocess
import sys
import types
from pathlib import Path
from typing import Any, ClassVar

import pytest

from safe_inspect.errors import RegistryError
from safe_inspect.plugins import Plugin
from safe_inspect.plugins import registry as module
from safe_inspect.plugins.registry import ENTRY_POINT_GROUP, Registry, registry
from safe_inspect.rewards import Reward
from safe_inspect.rewards.inspection import ObservedPointsReward

pytestmark = pytest.mark.usefixtures("clean_registry")


def test_built_in_plugins_are_known_by_name() -> None:
    assert registry.get("reward", "ObservedPointsReward") is ObservedPointsReward
    assert {"reward", "done", "part", "glue", "parameter", "constraint", "simulator"} <= set(registry.kinds())
    names = [name for name, _ in registry.items("reward")]
    assert names == sorted(names)


def test_defining_a_class_registers_it_under_its_name_or_another() -> None:
    class PlainReward(Reward):
        def __call__(self, step):
            return step.dt

    class LabelledReward(Reward, name="some label"):
        def __call__(self, step):
            return step.dt

    assert registry.get("reward", "PlainReward") is PlainReward
    assert registry.get("reward", "some label") is LabelledReward
    with pytest.raises(RegistryError):
        registry.get("reward", "LabelledReward")


def test_a_taken_name_is_refused_and_both_owners_are_reported() -> None:
    class PlainReward(Reward):
        def __call__(self, step):
            return step.dt

    with pytest.raises(RegistryError, match=r"'PlainReward' of .*Other.* is already registered for .*PlainReward"):

        class OtherReward(Reward, name="PlainReward"):
            def __call__(self, step):
                return step.dt

    assert registry.get("reward", "PlainReward") is PlainReward


def test_a_class_that_is_defined_again_replaces_itself() -> None:
    def define() -> type[Reward]:
        class CellReward(Reward):
            def __call__(self, step):
                return step.dt

        return CellReward

    first, second = define(), define()
    assert first is not second
    assert registry.get("reward", "CellReward") is second


def test_one_name_may_mean_two_kinds() -> None:
    class Twin(Plugin):
        kind: ClassVar[str] = "done"

        def __call__(self):
            return 0

    own = Registry()
    own._loaded = True
    own.add("done", "Twin", Twin)
    own.add("reward", "Twin", ObservedPointsReward)
    assert own.kinds() == ("done", "reward")
    assert own.get("done", "Twin") is Twin
    assert own.get("reward", "Twin") is ObservedPointsReward


@pytest.mark.parametrize(
    ("kind", "name", "text"),
    [
        ("reward", "ObservedPointReward", "did you mean `ObservedPointsReward`?"),
        ("reward", "observedpointsreward", "did you mean `ObservedPointsReward`?"),
        ("reward", "CrashDoneFunction", "'CrashDoneFunction' is a done; expected a reward here"),
        ("done", "safe_inspect.rewards.inspection.ObservedPointsReward", "is a reward; expected a done here"),
        ("reward", "safe_inspect.rewards.inspection.ObservedPointReward", "did you mean `ObservedPointsReward`?"),
        ("reward", "safe_inspect.reward.ObservedPointsReward", "no module 'safe_inspect.reward'"),
        ("reward", "no_such_package.plugins.MyReward", "no module 'no_such_package.plugins'"),
        ("reward", "no_such_package.plugins.MyReward", "add the folder that contains 'no_such_package' to PYTHONPATH"),
        ("reward", "Mine", "for a class of your own give its module too, as in my_module.Mine"),
        ("reward", "math.sqrt", "'math.sqrt' is not a plugin; a reward must be a subclass of safe_inspect.rewards.R"),
        ("reward", "safe_autonomy_sims.rewards.cwh.docking.DockingReward", "a path of safe-autonomy-sims"),
        ("reward", "corl.dones.episode_length_done.EpisodeLengthDone", "is a done; expected a reward here|unknown"),
        ("no kind", "anything", "unknown no kind 'anything'"),
    ],
)
def test_what_is_not_found(kind: str, name: str, text: str) -> None:
    with pytest.raises(RegistryError, match=text):
        registry.get(kind, name)


def write_module(folder: Path, monkeypatch: pytest.MonkeyPatch, name: str, text: str) -> None:
    (folder / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.delitem(sys.modules, name, raising=False)


_PLUGIN = """
from safe_inspect.rewards import Reward

class FarReward(Reward):
    def __call__(self, step):
        return step.after.range_to(None)
"""


def test_a_dotted_path_imports_its_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_module(tmp_path, monkeypatch, "ground_far_module", _PLUGIN)
    cls = registry.get("reward", "ground_far_module.FarReward")
    assert cls.__module__ == "ground_far_module"
    assert registry.get("reward", "FarReward") is cls


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("import no_such_dependency\n", "py:1: ModuleNotFoundError: No module named 'no_such_dependency'"),
        ("x = 1\n1 / 0\n", "py:2: ZeroDivisionError: division by zero"),
        ("class FarReward(:\n", "py:1: SyntaxError: invalid syntax"),
        ("raise SystemExit(3)\n", "py:1: SystemExit: 3"),
        (
            "from safe_inspect.rewards import Reward\nclass FarReward(Reward):\n    scale = 3\n",
            "ground_broken_module.py:2: `scale` has no type; write `scale: float` (setting)",
        ),
    ],
)
def test_a_module_that_fails_by_itself_is_named_with_its_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, shown: str
) -> None:
    write_module(tmp_path, monkeypatch, "ground_broken_module", text)
    with pytest.raises(RegistryError) as caught:
        registry.get("reward", "ground_broken_module.FarReward")
    assert str(caught.value).startswith("module 'ground_broken_module' cannot be imported: ")
    assert shown in str(caught.value)


@pytest.mark.parametrize("name", ["my-rewards", "my rewards.band", "rewards.", ""])
def test_what_is_not_a_module_path_is_refused_before_an_import(name: str) -> None:
    with pytest.raises(RegistryError, match="is not a module path"):
        module.import_user_module(name)


def test_an_abstract_class_is_not_a_plugin_to_name() -> None:
    with pytest.raises(RegistryError, match=r"'safe_inspect.rewards.Reward' is an abstract class; name one of"):
        registry.get("reward", "safe_inspect.rewards.Reward")


def test_a_class_that_lacks_a_method_is_refused_with_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = "from safe_inspect.rewards import Reward\n\n\nclass IdleReward(Reward):\n    pass\n"
    write_module(tmp_path, monkeypatch, "ground_idle_module", text)
    with pytest.raises(RegistryError, match=r"'ground_idle_module.IdleReward' is an abstract class; define `__call__`"):
        registry.get("reward", "ground_idle_module.IdleReward")


def test_a_package_that_cannot_be_imported_is_named_and_stops_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    class EntryPoint:
        module = "broken.plugins"
        dist = types.SimpleNamespace(name="broken-package")

        def load(self) -> None:
            raise ImportError("no module named 'thruster'")

    monkeypatch.setattr(module, "entry_points", lambda group: [EntryPoint()])
    with pytest.warns(RuntimeWarning, match=r"plugins of broken-package are not available.*broken.plugins.*'thruster'"):
        Registry().kinds()


@pytest.mark.parametrize("first", ["glues", "rewards", "platforms", "rta"])
def test_a_package_may_import_the_bases_of_any_kind(tmp_path: Path, first: str) -> None:
    """An entry point that is loaded while `safe_inspect.glues` is still being imported finds what it needs."""
    (tmp_path / "acme").mkdir()
    (tmp_path / "acme" / "__init__.py").write_text("from safe_inspect.glues import Normalizer, ObservationGlue\n")
    info = tmp_path / "acme-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{ENTRY_POINT_GROUP}]\nacme = acme\n")
    code = f"import safe_inspect.{first}; from safe_inspect.plugins.registry import registry; registry.kinds()"
    done = subprocess.run(
        [sys.executable, "-W", "error::RuntimeWarning", "-c", code],
        capture_output=True, text=True, timeout=60, env={**os.environ, "PYTHONPATH": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def test_entry_points_are_loaded_at_the_first_look_up(monkeypatch: pytest.MonkeyPatch) -> None:
    loaded: list[str] = []

    class EntryPoint:
        def load(self) -> types.ModuleType:
            loaded.append("loaded")
            return types.ModuleType("third_party")

    def entry_points(*, group: str) -> list[Any]:
        assert group == ENTRY_POINT_GROUP == "safe_inspect.plugins"
        return [EntryPoint()]

    monkeypatch.setattr(module, "entry_points", entry_points)
    fresh = Registry()
    assert not loaded
    fresh.kinds()
    fresh.kinds()
    assert loaded == ["loaded"]
