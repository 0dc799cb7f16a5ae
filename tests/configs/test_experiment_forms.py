"""Other forms of an experiment that safe-autonomy-sims allows."""

from __future__ import annotations

from safe_inspect.config.experiment import load_experiment


def test_lists_mean_mappings(copied, shipped):
    (copied / "lists.yml").write_text(
        """\
config: !include ./task-seed.yml
platform_config:
  - [blue0, !include ./platform.yml]
agent_config:
  - [blue0_ctrl, [blue0], !include ./agent-seed.yml, !include ./ppo-seed.yml]
"""
    )
    lists, shorter = load_experiment(copied / "lists.yml"), load_experiment(shipped)
    assert lists.spec == shorter.spec
    assert (lists.rllib, lists.algorithm) == (shorter.rllib, shorter.algorithm)


def test_plain_paths_mean_includes(copied, shipped):
    (copied / "paths.yml").write_text(
        """\
config: configs/translational-inspection/task-seed.yml
platform_config:
  - [blue0, configs/translational-inspection/platform.yml]
agent_config:
  - name: blue0_ctrl
    platforms: [blue0]
    config: ./agent-seed.yml
    policy: configs/translational-inspection/ppo-seed.yml
"""
    )
    assert load_experiment(copied / "paths.yml").spec == load_experiment(shipped).spec


def test_a_policy_may_be_left_out(copied):
    text = (copied / "experiment.yml").read_text()
    without = text.replace("    policy: !include ./ppo.yml\n", "")
    assert without != text
    (copied / "experiment.yml").write_text(without)
    assert load_experiment(copied / "experiment.yml").algorithm == "PPO"


ALIASES = {
    "agent.yml": {
        "agent: TrainableBaseAgent": "agent: corl.agents.base_agent.TrainableBaseAgent",
        "functor: RejectionSamplerInitializer":
            "functor: safe_autonomy_sims.rta.rta_rejection_sampler.RejectionSamplerInitializer",
        "functor: MaxDistanceDoneFunction": "functor: safe_autonomy_sims.dones.cwh.common.MaxDistanceDoneFunction",
    },
    "agent-seed.yml": {
        "functor: RTAGlueCWHInspection1v1":
            "functor: safe_autonomy_sims.rta.cwh.inspection_rta_1v1.RTAGlueCWHInspection1v1",
        "functor: ControllerGlue": "functor: corl.glues.common.controller_glue.ControllerGlue",
        "functor: ObserveSensor": "functor: corl.glues.common.observe_sensor.ObserveSensor",
        "functor: ObservedPointsReward":
            "functor: safe_autonomy_sims.rewards.cwh.inspection_rewards.ObservedPointsReward",
    },
    "task.yml": {
        "experiment_class: RllibExperiment":
            "experiment_class: corl.experiments.rllib_experiment.RllibExperiment",
    },
    "environment.yml": {
        "type: UniformParameter": "type: corl.libraries.parameters.UniformParameter",
        "type: InspectionSimulator": "type: safe_autonomy_sims.simulators.inspection_simulator.InspectionSimulator",
        "entity_class: Sun": "entity_class: safe_autonomy_simulation.sims.inspection.sun.Sun",
    },
}  # fmt: skip


def test_names_of_safe_autonomy_sims_mean_ours(copied, shipped):
    for file, names in ALIASES.items():
        text = (copied / file).read_text()
        for ours, theirs in names.items():
            assert ours in text
            text = text.replace(ours, theirs)
        (copied / file).write_text(text)
    assert load_experiment(copied / "experiment-seed.yml").spec == load_experiment(shipped).spec


def test_the_horizon_may_stand_among_the_rllib_keys(copied):
    environment = copied / "environment.yml"
    environment.write_text(environment.read_text().replace("horizon: 1224", "# horizon: 1224"))
    (copied / "rllib.yml").write_text((copied / "rllib.yml").read_text() + "horizon: 55\n")
    experiment = load_experiment(copied / "experiment.yml")
    assert "horizon" not in experiment.rllib
    assert {named.name: named.functor for named in experiment.spec.agents[0].dones}["EpisodeLengthDone"].horizon == 55
