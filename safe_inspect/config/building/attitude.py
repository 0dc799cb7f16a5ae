"""What platforms that turn ask of the simulator, of controllers and of what initial states give."""

from __future__ import annotations

from safe_inspect.config.building.reporting import KeyTuple, ReportProblem
from safe_inspect.config.models.experiment import AgentBody, ExperimentConfig
from safe_inspect.platforms.base import Controller
from safe_inspect.simulators.simulator import Simulator

_ENVIRONMENT: KeyTuple = ("config", "config", "env_config")


def with_attitude(config: ExperimentConfig, report: ReportProblem) -> ExperimentConfig:
    """Return the experiment with a simulator whose deputies turn, where its platforms do.

    Args:
        config: The validated models.
        report: Takes the path and the message of every mistake that is found.
    """
    turning = [index for index, entry in enumerate(config.platform_config) if entry.config.functor.turns]
    simulator: Simulator = config.config.config.env_config.simulator
    if not turning:
        if getattr(simulator, "sensor_fov", None) is not None and not simulator.turns:
            where = (*_ENVIRONMENT, "simulator", "config", "sensor_fov")
            report(where, "a camera that turns needs platforms that do; give them `platform: six-dof`, or remove this")
        return config
    for index, entry in enumerate(config.platform_config):
        if index not in turning:
            message = f"{entry.name} is a point and others turn; give all of them `platform: six-dof`, or none"
            report(("platform_config", index, "config", "platform"), message)
    try:
        made = simulator.with_attitude()
    except ValueError as error:
        report((*_ENVIRONMENT, "simulator"), str(error))
        return config
    task = config.config.config
    environment = task.env_config.model_copy(update={"simulator": made})
    body = task.model_copy(update={"env_config": environment})
    return config.model_copy(update={"config": config.config.model_copy(update={"config": body})})


def check_controls(body: AgentBody, simulator: Simulator, where: KeyTuple, report: ReportProblem) -> None:
    """Check that an agent's controllers give what the vehicle takes.

    Args:
        body: What the agent is made of.
        simulator: The simulator.
        where: Path of the body.
        report: Takes the path and the message of every mistake that is found.
    """
    size = simulator.compose()[0].control_size
    for index, part in enumerate(body.parts):
        if isinstance(part, Controller) and part.control_size > size:
            message = f"{part.part_name!r} commands a moment, and the platforms do not turn"
            report((*where, "parts", index), f"{message}; give them `platform: six-dof`, or remove it")
