from __future__ import annotations

import pytest

from safe_inspect.config.models import (
    AgentConfig,
    EntityConfig,
    PlatformConfig,
    Provider,
    TaskBody,
    TaskConfig,
)
from safe_inspect.platforms.controllers import RateController
from safe_inspect.plugins.registry import own_name, registry

#: Modules of CoRL, and their classes that have the same name here.
_CORL = {
    "agents.base_agent": "TrainableBaseAgent",
    "episode_parameter_providers.simple": "SimpleParameterProvider",
    "experiments.rllib_experiment": "RllibExperiment",
    "libraries.parameters": "ConstantParameter UniformParameter",
    "libraries.normalization": "StandardNormalNormalizer LinearNormalizer",
    "glues.common.controller_glue": "ControllerGlue",
    "glues.common.observe_sensor": "ObserveSensor",
    "dones.episode_length_done": "EpisodeLengthDone",
}
#: Modules of safe-autonomy-sims, and their classes that have the same name here.
_SIMS = {
    "platforms.cwh.cwh_properties": "ThrustProp MomentProp",
    "platforms.cwh.cwh_platform": "CWHPlatform",
    "rta.rta_rejection_sampler": "RejectionSampler RejectionSamplerInitializer",
    "rta.cwh.inspection_rta_1v1": "RTAGlueCWHInspection1v1",
    "simulators.initializers.cwh": """
        CWH3DRadialWithSunInitializer CWHSixDOFRadialInitializer PositionVelocityInitializer Docking3DRadialInitializer
    """,
    "simulators.initializers.docking_initializer": "Docking3DRadialInitializer",
    "simulators.initializers.initializer": "SimAttributeAccessor",
    "simulators.inspection_simulator": "InspectionSimulator InspectionCallbacks",
    "dones.common_dones": """
        CollisionDoneFunction MultiagentSuccessDoneFunction SetAllDoneFunction TimeoutDoneFunction
    """,
    "dones.cwh.common": "MaxDistanceDoneFunction CrashDoneFunction TerminalRewardSaturationDoneFunction",
    "dones.cwh.inspection_dones": """
        SafeSuccessfulInspectionDoneFunction CrashAfterSuccessfulInspectionDoneFunction SuccessfulInspectionDoneFunction
    """,
    "dones.cwh.docking_dones": "SuccessfulDockingDoneFunction",
    "rewards.cwh.inspection_rewards": """
        ObservedPointsReward InspectionSuccessReward SafeInspectionSuccessReward InspectionCrashReward
        InspectionDeltaVReward InspectionRTAReward
    """,
    "rewards.cwh.docking_rewards": """
        DockingDistanceExponentialChangeReward DockingDeltaVReward DockingVelocityConstraintReward DockingSuccessReward
        DockingFailureReward
    """,
    "rewards.cwh.done_state_rewards": "WinLoseDoneReward",
    "rewards.cwh.live_timestep_reward": "LiveTimestepReward",
    "rewards.cwh.gaussian_decay_from_target_value": "GaussianDecayFromTargetValue",
    "glues.six_dof_glues": "RotateVectorToLocalRef3d MagNorm3DGlue AngleToUnitVector",
    "glues.coordinate_axis_glue": "CoordinateAxisGlue",
    "glues.dot_product_glue": "DotProductGlue",
    "glues.magnitude_glue": "SimsMagnitudeGlue",
    "glues.vel_limit_glue": "VelocityLimitGlue",
}

#: Published paths, each with the name here.
ALIASES: dict[str, str] = {
    f"{package}.{module}.{name}": name
    for package, modules in (("corl", _CORL), ("safe_autonomy_sims", _SIMS))
    for module, names in modules.items()
    for name in names.split()
} | {
    # safe-autonomy-simulation, and safe-autonomy-dynamics before it
    "safe_autonomy_simulation.sims.inspection.sun.Sun": "Sun",
    "safe_autonomy_simulation.sims.inspection.sun_model.SunEntity": "Sun",
    "safe_autonomy_dynamics.cwh.sun_model.SunEntity": "Sun",
}

#: Names of the grammar that do not mean a plugin, each with the check of the model that takes it.
_GRAMMAR = {
    "TrainableBaseAgent": lambda name: AgentConfig.__pydantic_validator__.validate_assignment(
        AgentConfig.model_construct(), "agent", name
    ),
    "SimpleParameterProvider": lambda name: Provider(type=name),
    "RllibExperiment": lambda name: TaskConfig.__pydantic_validator__.validate_assignment(
        TaskConfig.model_construct(), "experiment_class", name
    ),
    "InspectionCallbacks": lambda name: TaskBody.__pydantic_validator__.validate_assignment(
        TaskBody.model_construct(), "extra_callbacks", [name]
    ),
    "Sun": lambda name: EntityConfig(entity_class=name),
    "CWHPlatform": lambda name: PlatformConfig(platform=name),
    "ThrustProp": lambda name: RateController(property_class=name),
    "MomentProp": lambda name: RateController(axis=3, property_class=name),
}


@pytest.mark.parametrize("alias", sorted(ALIASES))
def test_alias_means_a_plugin_or_a_name_of_the_grammar(alias: str) -> None:
    name = ALIASES[alias]
    assert own_name(alias) == name
    kinds = [kind for kind in registry.kinds() if name in dict(registry.items(kind))]
    if name in _GRAMMAR:
        _GRAMMAR[name](alias)
    else:
        assert len(kinds) == 1, name
        assert registry.get(kinds[0], alias).registered_name == name


def test_other_names_are_kept() -> None:
    for name in ("Sun", "corl", "my_package.rewards.MyReward", "corlike.rewards.MyReward"):
        assert own_name(name) == name
