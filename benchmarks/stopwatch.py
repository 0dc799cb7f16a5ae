"""Where the time of an environment's step goes: a watch on the parts of the step."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest.mock import patch

from safe_inspect.environments import TeamEnvironment
from safe_inspect.environments.fused_step import FusedGroup
from safe_inspect.environments.thrust import Thrusters
from safe_inspect.simulators import simulator


class Stopwatch:
    """Adds up the time of each section, without that of the sections inside it."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._inner = [0.0]

    def wrap(self, section: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function with its time on the watch."""

        def timed(*args: Any, **kwargs: Any) -> Any:
            begin = time.perf_counter()
            self._inner.append(0.0)
            try:
                return function(*args, **kwargs)
            finally:
                spent = time.perf_counter() - begin
                self.seconds[section] = self.seconds.get(section, 0.0) + spent - self._inner.pop()
                self._inner[-1] += spent

        return timed


@contextmanager
def on_the_watch(watch: Stopwatch, environment: TeamEnvironment) -> Iterator[None]:
    """Put the parts of an environment's step on the watch."""
    places: dict[tuple[Any, str], str] = {
        (environment.simulation, "_advance"): "dynamics",
        **{
            (type(component), "step"): "points" if name == "InspectionPoints" else f"component {name}"
            for name, component in environment.simulation.components.items()
        },
        (simulator.State, "copy_from"): "copy of the state",
        (simulator.Simulation, "step"): "rest of the simulator",
        (Thrusters, "__call__"): "control",
        (Thrusters, "clipped"): "control",
        (FusedGroup, "evaluate_step"): "sensors, rewards and dones together",
        (TeamEnvironment, "reset"): "resets",
        (TeamEnvironment, "step"): "rest of the environment",
    }
    for agent in environment.spec.agents:
        plugins = {
            "sensors and glues": (*agent.observation_glues, *agent.sensors.values()),
            "rewards": [named.functor for named in agent.rewards],
            "dones": [named.functor for named in (*agent.dones, *environment.spec.shared_dones)],
        }
        for section, group in plugins.items():
            for plugin in group:
                places[type(plugin), "__call__"] = section
        for sensor in agent.sensors.values():
            if "remember" in vars(type(sensor)):
                places[type(sensor), "remember"] = "clustering"
    with ExitStack() as stack:
        for (owner, name), section in places.items():
            stack.enter_context(patch.object(owner, name, watch.wrap(section, getattr(owner, name))))
        yield
