"""Aliases: dotted paths of CoRL and safe-autonomy-sims, each with the name of this package's plugin for it."""

from __future__ import annotations

_SAS = "safe_autonomy_sims"
_INITIALIZERS = f"{_SAS}.simulators.initializers"
_REWARDS = f"{_SAS}.rewards.cwh.inspection_rewards"
_DOCKING = f"{_SAS}.rewards.cwh.docking_rewards"

ALIASES: dict[str, str] = {
    # corl
    "corl.agents.base_agent.TrainableBaseAgent": "TrainableBaseAgent",
    "corl.episode_parameter_providers.simple.SimpleParameterProvider": "SimpleParameterProvider",
    "corl.experiments.rllib_experiment.RllibExperiment": "RllibExperiment",
    "corl.libraries.parameters.ConstantParameter": "ConstantParameter",
    "corl.libraries.parameters.UniformParameter": "UniformParameter",
    "corl.libraries.normalization.StandardNormalNormalizer": "StandardNormalNormalizer",
    "corl.libraries.normalization.LinearNormalizer": "LinearNormalizer",
    "corl.glues.common.controller_glue.ControllerGlue": "ControllerGlue",
    "corl.glues.common.observe_sensor.ObserveSensor": "ObserveSensor",
    "corl.dones.episode_length_done.EpisodeLengthDone": "EpisodeLengthDone",
    # safe-autonomy-sims
    f"{_SAS}.platforms.cwh.cwh_properties.ThrustProp": "ThrustProp",
    f"{_SAS}.platforms.cwh.cwh_properties.MomentProp": "MomentProp",
    f"{_SAS}.platforms.cwh.cwh_platform.CWHPlatform": "CWHPlatform",
    f"{_SAS}.rta.rta_rejection_sampler.RejectionSampler": "RejectionSampler",
    f"{_SAS}.rta.rta_rejection_sampler.RejectionSamplerInitializer": "RejectionSamplerInitializer",
    f"{_SAS}.rta.cwh.inspection_rta_1v1.RTAGlueCWHInspection1v1": "RTAGlueCWHInspection1v1",
    f"{_INITIALIZERS}.cwh.CWH3DRadialWithSunInitializer": "CWH3DRadialWithSunInitializer",
    f"{_INITIALIZERS}.cwh.CWHSixDOFRadialInitializer": "CWHSixDOFRadialInitializer",
    f"{_INITIALIZERS}.cwh.PositionVelocityInitializer": "PositionVelocityInitializer",
    f"{_INITIALIZERS}.initializer.SimAttributeAccessor": "SimAttributeAccessor",
    f"{_SAS}.dones.common_dones.CollisionDoneFunction": "CollisionDoneFunction",
    f"{_SAS}.dones.common_dones.MultiagentSuccessDoneFunction": "MultiagentSuccessDoneFunction",
    f"{_SAS}.dones.cwh.common.MaxDistanceDoneFunction": "MaxDistanceDoneFunction",
    f"{_SAS}.dones.cwh.common.CrashDoneFunction": "CrashDoneFunction",
    f"{_SAS}.dones.common_dones.SetAllDoneFunction": "SetAllDoneFunction",
    f"{_SAS}.dones.cwh.inspection_dones.SafeSuccessfulInspectionDoneFunction": "SafeSuccessfulInspectionDoneFunction",
    f"{_SAS}.dones.cwh.inspection_dones.CrashAfterSuccessfulInspectionDoneFunction": (
        "CrashAfterSuccessfulInspectionDoneFunction"
    ),
    f"{_SAS}.dones.cwh.inspection_dones.SuccessfulInspectionDoneFunction": "SuccessfulInspectionDoneFunction",
    f"{_REWARDS}.ObservedPointsReward": "ObservedPointsReward",
    f"{_REWARDS}.InspectionSuccessReward": "InspectionSuccessReward",
    f"{_REWARDS}.SafeInspectionSuccessReward": "SafeInspectionSuccessReward",
    f"{_REWARDS}.InspectionCrashReward": "InspectionCrashReward",
    f"{_REWARDS}.InspectionDeltaVReward": "InspectionDeltaVReward",
    f"{_REWARDS}.InspectionRTAReward": "InspectionRTAReward",
    f"{_DOCKING}.DockingDistanceExponentialChangeReward": "DockingDistanceExponentialChangeReward",
    f"{_DOCKING}.DockingDeltaVReward": "DockingDeltaVReward",
    f"{_DOCKING}.DockingVelocityConstraintReward": "DockingVelocityConstraintReward",
    f"{_DOCKING}.DockingSuccessReward": "DockingSuccessReward",
    f"{_DOCKING}.DockingFailureReward": "DockingFailureReward",
    f"{_SAS}.dones.common_dones.TimeoutDoneFunction": "TimeoutDoneFunction",
    f"{_SAS}.dones.cwh.common.TerminalRewardSaturationDoneFunction": "TerminalRewardSaturationDoneFunction",
    f"{_SAS}.dones.cwh.docking_dones.SuccessfulDockingDoneFunction": "SuccessfulDockingDoneFunction",
    f"{_SAS}.rewards.cwh.done_state_rewards.WinLoseDoneReward": "WinLoseDoneReward",
    f"{_SAS}.rewards.cwh.live_timestep_reward.LiveTimestepReward": "LiveTimestepReward",
    f"{_SAS}.rewards.cwh.gaussian_decay_from_target_value.GaussianDecayFromTargetValue": "GaussianDecayFromTargetValue",
    f"{_SAS}.glues.six_dof_glues.RotateVectorToLocalRef3d": "RotateVectorToLocalRef3d",
    f"{_SAS}.glues.six_dof_glues.MagNorm3DGlue": "MagNorm3DGlue",
    f"{_SAS}.glues.six_dof_glues.AngleToUnitVector": "AngleToUnitVector",
    f"{_SAS}.glues.coordinate_axis_glue.CoordinateAxisGlue": "CoordinateAxisGlue",
    f"{_SAS}.glues.dot_product_glue.DotProductGlue": "DotProductGlue",
    f"{_SAS}.glues.magnitude_glue.SimsMagnitudeGlue": "SimsMagnitudeGlue",
    f"{_SAS}.glues.vel_limit_glue.VelocityLimitGlue": "VelocityLimitGlue",
    f"{_INITIALIZERS}.cwh.Docking3DRadialInitializer": "Docking3DRadialInitializer",
    f"{_INITIALIZERS}.docking_initializer.Docking3DRadialInitializer": "Docking3DRadialInitializer",
    f"{_SAS}.simulators.inspection_simulator.InspectionSimulator": "InspectionSimulator",
    f"{_SAS}.simulators.inspection_simulator.InspectionCallbacks": "InspectionCallbacks",
    # safe-autonomy-simulation, and safe-autonomy-dynamics before it
    "safe_autonomy_simulation.sims.inspection.sun.Sun": "Sun",
    "safe_autonomy_simulation.sims.inspection.sun_model.SunEntity": "Sun",
    "safe_autonomy_dynamics.cwh.sun_model.SunEntity": "Sun",
}
