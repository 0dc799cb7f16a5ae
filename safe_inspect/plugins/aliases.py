"""Aliases: dotted paths of CoRL and safe-autonomy-sims, each with the name of this package's plugin for it."""

from __future__ import annotations

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
