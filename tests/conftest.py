from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import build_experiment, load_experiment
from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.plugins.registry import registry

# What starts the tests may ignore signals (`nohup`, background jobs), and every process that is started here would too.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
for _number in (signal.SIGTERM, signal.SIGHUP):
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, signal.SIG_DFL)

# Tables leave out columns and help texts are wrapped where the terminal is narrow; tests read them whole.
os.environ["COLUMNS"] = "240"


#: These files begin, in this order. The first compiles the safety filters for a minute or two, while another process
#: runs the trainings: two processes that began with filters would both compile them.
_FIRST = ("tests/contract/test_every_plugin.py", "tests/experiments/")
#: What starts Ray. Two of these at a time take two to eight times as long as one after the other on two cores.
_RAY = (
    "tests/experiments/",
    "tests/examples/test_beacon_package.py",
    "tests/evaluation/test_missions.py",
    "tests/documentation/test_tutorials.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    def place(item: pytest.Item) -> int:
        return next((k for k, name in enumerate(_FIRST) if item.nodeid.startswith(name)), len(_FIRST))

    items.sort(key=place)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give each process whole files, and what starts Ray to one of them."""
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):  # type: ignore[misc]
        def _split_scope(self, nodeid: str) -> str:
            return "Ray" if nodeid.startswith(_RAY) else super()._split_scope(nodeid)

    return Scheduling(config, log) if config.getvalue("dist") == "loadfile" else None


@pytest.fixture
def clean_registry() -> Iterator[None]:
    """Forget the plugins that a test defines, and before it those of the snippets of other tests."""
    kept = {
        kind: {name: plugin for name, plugin in registry.items(kind) if not plugin.__module__.startswith("my_")}
        for kind in registry.kinds()
    }
    registry._classes.update({kind: dict(plugins) for kind, plugins in kept.items()})
    yield
    for kind in list(registry._classes):
        registry._classes[kind] = kept.get(kind, {})


@pytest.fixture(scope="session")
def long_form() -> Path:
    """Return folders in which some of the shipped experiments are written with all that they consist of."""
    return Path(__file__).parent / "long_form"


@pytest.fixture(scope="session")
def shipped() -> Path:
    """Return the shipped experiment file."""
    return configs_root() / "translational-inspection" / "experiment-seed.yml"


@pytest.fixture
def fixed_start(shipped: Path) -> Callable[..., EnvironmentSpec]:
    """Return the shipped task with every episode begun in one and the same state."""

    def spec(
        position: Iterable[float],
        velocity: Iterable[float] = (0.0, 0.0, 0.0),
        sun_angle: float = 0.0,
        overrides: Iterable[str] = (),
        chief: Iterable[float] = (0.0, 0.0, 0.0),
    ) -> EnvironmentSpec:
        def body(where: Iterable[float], speed: Iterable[float]) -> dict[str, float]:
            return dict(zip(("x", "y", "z", "x_dot", "y_dot", "z_dot"), [*where, *speed], strict=True))

        initializer = {"functor": "PositionVelocityInitializer"}
        tree = load_experiment(shipped, overrides).resolved
        tree["config"]["config"]["env_config"]["simulator_reset_parameters"] = {
            "additional_entities": {
                "chief": {"platform": "cwh", "initializer": initializer, "config": body(chief, (0.0, 0.0, 0.0))},
                "sun": {"entity_class": "Sun", "config": {"theta": sun_angle}},
            }
        }
        tree["agent_config"][0]["config"]["config"]["simulator_reset_parameters"] = {
            "initializer": initializer,
            "config": body(position, velocity),
        }
        return build_experiment(tree).spec

    return spec
