from __future__ import annotations

import copy
import warnings

import pytest

from safe_inspect.config.experiment import load_experiment
from safe_inspect.config.keys.old_keys import OTHER_WORDS
from safe_inspect.config.loading.loader import load
from safe_inspect.config.loading.located import locate
from safe_inspect.config.overrides import apply_overrides
from safe_inspect.errors import ConfigError

TREE = """\
rllib: {lr: 1, train_batch_size: 1500, 1: one}
agent_config:
  blue0_ctrl: &agent
    config:
      parts:
        - {part: RateController, config: {name: X Thrust, axis: 0}}
        - {part: peer.parts.Sensor_Position}
      glues:
        - {functor: peer.glues.ObserveSensor, config: {sensor: Sensor_Position, scale: 1}}
        - {functor: peer.glues.ObserveSensor, config: {sensor: Sensor_Velocity, scale: 2}}
      rewards:
        - {name: Points, functor: peer.ObservedPointsReward, config: {scale: 0.01}}
        - {name: Crash, functor: Points, config: {scale: -1}}
records:
  - [blue0, [platform0], {agent: A, config: {rewards: {scale: 3}}}, {policy: P, config: {lr: 4}}]
  - [blue1, [platform1], {agent: B, config: {}}, {policy: Q}]
"""


NONE = "not an override; write it as `path.of.keys=value`, or as `~path.of.keys` to remove them"


@pytest.fixture
def tree(write):
    write({"a.yml": TREE})
    return load("a.yml")


def problem(tree, override: str) -> str:
    with pytest.raises(ConfigError) as caught:
        apply_overrides(tree, [override])
    (only,) = caught.value.problems
    return str(only)


@pytest.mark.parametrize(
    ("override", "path", "value"),
    [
        ("rllib.lr=1e-4", ("rllib", "lr"), 1e-4),
        ("rllib.1=two", ("rllib", 1), "two"),
        ("rllib.new=[1, {a: b=c}]", ("rllib", "new"), [1, {"a": "b=c"}]),
        ("rllib.lr=null", ("rllib", "lr"), None),
        ("train_batch_size=2000", ("rllib", "train_batch_size"), 2000),
        ("records.0.0=red", ("records", 0, 0), "red"),
        ("records.blue0.policy=R", ("records", 0, 3, "policy"), "R"),
        ("records.blue0.config.rewards.scale=5", ("records", 0, 2, "config", "rewards", "scale"), 5),
        ("records.blue0.config.lr=5", ("records", 0, 3, "config", "lr"), 5),
        ("records.blue1.agent=1", ("records", 1, 2, "agent"), 1),
        ("agent_config.blue0_ctrl.config.rewards.1.config.scale=2", ("rewards", 1, "config", "scale"), 2),
        ("agent_config.blue0_ctrl.config.rewards.ObservedPointsReward.name=new", ("rewards", 0, "name"), "new"),
        ("ObservedPointsReward.config.scale=0.02", ("rewards", 0, "config", "scale"), 0.02),
        ("rewards.Points.config.scale=7", ("rewards", 0, "config", "scale"), 7),
        ("glues.Sensor_Velocity.config.scale=8", ("glues", 1, "config", "scale"), 8),
        ("X Thrust.config.axis=2", ("parts", 0, "config", "axis"), 2),
        ("parts.Sensor_Position=3", ("parts", 1), 3),
        ("agent_config.blue0_ctrl.config.parts.RateController.config.extra=9", ("parts", 0, "config", "extra"), 9),
    ],
)  # fmt: skip
def test_one_place_is_replaced(tree, override, path, value):
    if path[0] not in tree:
        path = ("agent_config", "blue0_ctrl", "config", *path)
    before = copy.deepcopy(tree)
    changed = apply_overrides(tree, [override])
    assert tree == before
    node = changed
    for key in path:
        node = node[key]
    assert node == value
    expected = copy.deepcopy(before)
    parent = expected
    for key in path[:-1]:
        parent = parent[key]
    parent[path[-1]] = value
    assert changed == expected
    assert str(locate(changed, path)) == f"command line: {override}"


@pytest.mark.parametrize(
    ("override", "path", "left"),
    [
        ("~rllib.lr", ("rllib",), ["train_batch_size", 1]),
        ("~train_batch_size", ("rllib",), ["lr", 1]),
        ("~records.blue0", ("records",), [0]),
    ],
)
def test_a_place_is_removed(tree, override, path, left):
    before = copy.deepcopy(tree)
    changed = apply_overrides(tree, [override])
    assert tree == before
    assert list(changed[path[0]]) == left if path[0] == "rllib" else len(changed["records"]) == 1
    if path[0] == "records":
        assert changed["records"][0][0] == "blue1"
        assert str(locate(changed, ("records", 0))) == "a.yml:16"


def test_an_index_may_be_written_as_messages_write_it(tree):
    for path in ("records[0][3].config.lr", "records.0.3.config.lr"):
        assert apply_overrides(tree, [f"{path}=5"])["records"][0][3] == {"policy": "P", "config": {"lr": 5}}
    scale = "agent_config.blue0_ctrl.config.rewards[1].config.scale"
    changed = apply_overrides(tree, [f"{scale}=5"])
    assert [each["config"]["scale"] for each in changed["agent_config"]["blue0_ctrl"]["config"]["rewards"]] == [0.01, 5]


def test_other_places_keep_their_locations(tree):
    changed = apply_overrides(tree, ["rllib.lr={a: {b: 1}}"])
    assert str(locate(changed, ("rllib", "train_batch_size"))) == "a.yml:1"
    assert str(locate(changed, ("rllib", "lr", "a", "b"))) == "command line: rllib.lr={a: {b: 1}}"


def test_what_an_anchor_shares_is_replaced_in_one_place_only(write):
    write({"a.yml": "a: &a {x: {y: 1}}\nb: *a\n"})
    assert apply_overrides(load("a.yml"), ["b.x.y=2"]) == {"a": {"x": {"y": 1}}, "b": {"x": {"y": 2}}}


def test_overrides_apply_in_order_and_take_includes(tree, write):
    write({"ppo.yml": "lr: 5\n"})
    changed = apply_overrides(tree, ["rllib=!include ppo.yml", "rllib.lr=6", "rllib.clip=7"])
    assert changed["rllib"] == {"lr": 6, "clip": 7}


def test_a_suffix_that_fits_several_places_lists_them(tree):
    assert problem(tree, "lr=2") == (
        "command line: lr=2: `lr` fits 2 places; write one of `rllib.lr`, `records.0.3.config.lr`"
    )
    assert problem(tree, "glues.ObserveSensor.config.scale=2") == (
        "command line: glues.ObserveSensor.config.scale=2: `glues.ObserveSensor.config.scale` fits 2 places; "
        "write one of "
        "`agent_config.blue0_ctrl.config.glues.0.config.scale`, `agent_config.blue0_ctrl.config.glues.1.config.scale`"
    )


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("rllib.lr", NONE),
        ("rllib..lr=1", NONE),
        ("=1", NONE),
        ("~lr=1", NONE),
        ("rllib.lr= ", "the value is empty; give a value, write `rllib.lr=null`, or `~rllib.lr` to remove it"),
        ("~recordz", "there is no `recordz` in the configuration; did you mean `records`?"),
        ("train_batch_s=1", "there is no `train_batch_s` in the configuration; did you mean `train_batch_size`?"),
        ("rlib.lr=1", "there is no `rlib` in the configuration; did you mean `rllib`?"),
        ("rllib.modle.act=1", "there is no `modle` in `rllib`; known: `1`, `lr`, `train_batch_size`"),
        ("rllib.lr.x=1", "there is no `x` in `rllib.lr`, which contains no keys"),
        ("axis.scale=1", "no path of the configuration ends in `axis.scale`; write it from the root"),
        (
            "agent_config.blue0_ctrl.config.rewards.Pointz.config.scale=1",
            "there is no `Pointz` in `agent_config.blue0_ctrl.config.rewards`; did you mean `Points`?",
        ),
        (
            "agent_config.blue0_ctrl.config.parts.7=1",
            "there is no `7` in `agent_config.blue0_ctrl.config.parts`; "
            "known: `RateController`, `Sensor_Position`, `X Thrust`",
        ),
    ],
)  # fmt: skip
def test_an_override_that_fits_nothing(tree, override, message):
    assert problem(tree, override) == f"command line: {override}: {message}"


def test_a_value_that_is_no_yaml(tree):
    assert problem(tree, "rllib.lr=[1").startswith("command line: rllib.lr=[1: not valid YAML: the brackets `[`")


def test_all_wrong_overrides_are_reported_together(tree):
    with pytest.raises(ConfigError) as caught:
        apply_overrides(tree, ["nothing=1", "rllib.lr=3", "lr"])
    assert [p.location.text for p in caught.value.problems] == ["nothing=1", "lr"]


TASK = ("config", "config")
LOCAL = (*TASK, "rllib_configs", "local")
POLICY = ("agent_config", 0, "policy", "config")


@pytest.mark.parametrize(
    ("override", "path", "value"),
    [
        ("learner=stock", (*LOCAL, "learner"), "stock"),
        ("torch_num_threads=2", (*LOCAL, "torch_num_threads"), 2),
        ("kl_target=0.1", (*LOCAL, "kl_target"), 0.1),
        ("local.grad_clip=1", (*LOCAL, "grad_clip"), 1),
        ("rllib_configs.gamma=0.9", (*LOCAL, "gamma"), 0.9),
        ("rllib_configs.seed=3", (*LOCAL, "seed"), 3),
        ("initial_weights=docking", (*POLICY, "model_config", "initial_weights"), "docking"),
        ("training_iteration=2", (*TASK, "tune_config", "stop", "training_iteration"), 2),
        ("tune_config.stop.time_total_s=5", (*TASK, "tune_config", "stop", "time_total_s"), 5),
        ("success_rate=0.9", (*TASK, "tune_config", "stop", "success_rate"), 0.9),
        ("num_samples=2", (*TASK, "tune_config", "num_samples"), 2),
        ("num_cpus=4", (*TASK, "ray_config", "num_cpus"), 4),
        ("num_workers=2", (*LOCAL, "num_env_runners"), 2),
        ("lambda=0.9", (*POLICY, "lambda_"), 0.9),
        ("points_algorithm=cmu", (*TASK, "env_config", "simulator", "config", "inspection_points_map", "chief",
                                  "points_algorithm"), "cmu"),
    ],
)  # fmt: skip
def test_a_key_that_no_file_has_is_known_by_its_name(override, path, value):
    experiment = load_experiment("configs/translational-inspection/experiment.yml", [override])
    node = experiment.tree
    for key in path:
        node = node[key]
    assert node == value
    assert str(locate(experiment.tree, path)) == f"command line: {override}"


def test_keys_are_known_where_the_task_says_nothing_of_learning():
    tree = {"config": {"config": {"env_config": {}}}, "platform_config": [], "agent_config": [{"name": "blue"}]}
    changed = apply_overrides(tree, ["lr=1", "fcnet_hiddens=[4]", "training_iteration=1"])["config"]["config"]
    assert changed["rllib_configs"] == {"default": {"lr": 1, "model_config": {"fcnet_hiddens": [4]}}}
    assert changed["tune_config"] == {"stop": {"training_iteration": 1}}


def test_a_key_that_several_places_may_have_and_one_that_is_misspelt():
    with pytest.raises(ConfigError, match="did you mean `kl_target`"):
        load_experiment("configs/translational-inspection/experiment.yml", ["kl_targt=1"])
    with pytest.raises(ConfigError, match=r"`output_units` fits \d+ places"):
        load_experiment("configs/translational-inspection/experiment.yml", ["output_units=km"])


@pytest.mark.parametrize("path", ["blue0_ctrl.policy.config.vf_clip_param", "blue0_ctrl.policy.vf_clip_param"])
def test_a_key_that_stands_elsewhere_is_to_be_written_alone(path):
    with pytest.raises(ConfigError, match=r"is in config\.config\.rllib_configs\.local; if it is meant, write `vf_c"):
        load_experiment("configs/translational-inspection/experiment.yml", [f"{path}=5"])


@pytest.mark.parametrize("path", ["RTAGlueCWHInspection1v1", "blue0_ctrl.glues.RTAGlueCWHInspection1v1"])
def test_a_field_that_no_file_gives_is_set_without_its_config(path):
    file, field = "configs/translational-inspection/experiment.yml", "intervention=backup"
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # the path names the place
        found = load_experiment(file, [f"{path}.{field}"]).resolved
    assert found == load_experiment(file, [f"RTAGlueCWHInspection1v1.config.{field}"]).resolved
    with pytest.raises(ConfigError, match="did you mean `intervention`"):
        load_experiment(file, [f"{path}.interventoin=backup"])


def test_a_key_that_its_mapping_may_not_have_lists_those_that_it_may():
    file = "configs/multiagent-translational-inspection/experiment.yml"
    with pytest.raises(ConfigError, match=r"`separation` in `env_config.rta.config`; known: `collision_radius`"):
        load_experiment(file, ["env_config.rta.config.separation=1"])


def test_candidates_are_named_by_the_item_that_they_belong_to():
    file = "configs/translational-inspection/experiment.yml"
    with pytest.raises(ConfigError, match="`enabled` fits 3 places; write one of `RTAGlueCWHInspection1v1") as refused:
        load_experiment(file, ["enabled=True"])
    with pytest.raises(ConfigError, match=r"places; .*`RTAGlueCWHInspection1v1.config.disturbance`"):
        load_experiment(file, ["disturbance={velocity: 1e-4}"])  # no file has the key there
    for candidate in str(refused.value).split("write one of ")[1].split(", "):
        load_experiment(file, [f"{candidate.strip('`')}=True"])


SHIPPED = "configs/translational-inspection/experiment.yml"


@pytest.mark.parametrize(("word", "key"), OTHER_WORDS.items())
def test_a_word_of_another_library_leads_to_the_key(word, key):
    with pytest.raises(ConfigError, match=rf"`{word}` is not a key here; did you mean `{key}=7`\?$"):
        load_experiment(SHIPPED, [f"{word}=7"])
    with pytest.raises(ConfigError) as refused:  # the key itself is known, whatever it makes of the value
        load_experiment(SHIPPED, [f"{key}=[1, {{"])
    assert "not valid YAML" in str(refused.value)


def test_a_word_of_another_library_is_a_key_where_the_path_says_so():
    path = "Sensor_UninspectedPoints.config.max_iterations"
    spec = load_experiment(SHIPPED, [f"{path}=4"]).spec
    assert next(sensor for name, sensor in spec.agents[0].sensors.items() if "Uninsp" in name).max_iterations == 4


def test_a_word_of_another_library_in_its_mapping():
    with pytest.raises(ConfigError, match="did you mean `num_env_steps_sampled_lifetime`"):
        load_experiment(SHIPPED, ["tune_config.stop.total_timesteps=4"])


@pytest.mark.parametrize("word", ["noise", "softness", "tolerance"])
def test_what_is_not_near_is_not_suggested(word):
    with pytest.raises(ConfigError, match=f"there is no `{word}` in the configuration; known: "):
        load_experiment(SHIPPED, [f"{word}=1"])


def test_a_short_key_that_only_a_plugin_has_is_shown_with_its_place(recwarn):
    with pytest.warns(UserWarning, match=r"`max_rejections=5` sets config\..*max_rejections, which no file gives"):
        load_experiment(SHIPPED, ["max_rejections=5"])
    recwarn.clear()
    load_experiment(SHIPPED, ["kl_target=0.1", "horizon=600", "init_state.config.max_rejections=5"])
    assert not recwarn.list


def test_a_number_that_occurs_in_several_places_is_replaced_in_all_as_the_message_says():
    with pytest.raises(ConfigError, match="`mass` fits 3 places; all are 12 now; to replace each, write ") as refused:
        load_experiment(SHIPPED, ["mass=20"])
    every = str(refused.value).partition("to replace each, write ")[2].split()
    with pytest.raises(ConfigError, match=r"to replace each, write '\S+mass=20 kg' '"):
        load_experiment(SHIPPED, ["mass=20 kg"])
    spec = load_experiment(SHIPPED, every).spec
    assert [platform.mass for platform in spec.platforms.values()] == [20.0]


@pytest.mark.parametrize(
    "override",
    [
        "parts.Sensor_Position.config={errors: {noise: 0.5}}",
        "parts.3.config.errors={noise: 50 cm}",
        "parts.3.errors={noise: 50 cm}",
        "blue0_ctrl.parts.Sensor_Position.errors={noise: 50 cm}",
    ],
)
def test_a_short_path_reaches_the_config_of_a_plugin_without_one(override):
    (part,) = [
        part
        for part in load_experiment("configs/docking/experiment.yml", [override]).spec.agents[0].parts.values()
        if part.registered_name == "Sensor_Position"
    ]
    assert part.errors.noise == 0.5


def test_inner_parts_of_a_path_may_leave_out_config(tree):
    found = apply_overrides(tree, ["blue0_ctrl.rewards+=[{functor: peer.Fuel}]"])
    assert found == apply_overrides(tree, ["blue0_ctrl.config.rewards+=[{functor: peer.Fuel}]"])


def test_a_list_that_a_reference_gives_is_changed_in_the_store():
    for override in ("RTAGlueCWHInspection1v1.config.constraints+=[a.B]", "RTAGlueCWHInspection1v1.constraints+=[a.B]"):
        with pytest.raises(ConfigError, match=r"by a reference; write `reference_store\.constraints\+=\.\.\.`"):
            load_experiment("configs/translational-inspection/experiment.yml", [override])


def test_a_plus_appends_to_the_list_of_a_path(tree):
    before = copy.deepcopy(tree)
    found = apply_overrides(tree, ["rewards+=[{functor: peer.Fuel}]"])
    rewards = found["agent_config"]["blue0_ctrl"]["config"]["rewards"]
    assert rewards == [*before["agent_config"]["blue0_ctrl"]["config"]["rewards"], {"functor": "peer.Fuel"}]
    assert str(locate(found, ("agent_config", "blue0_ctrl", "config", "rewards", 2))).startswith("command line")
    assert tree == before
    for wrong, words in {
        "rewadrs+=[1]": "there is no `rewadrs` in the configuration; did you mean `rewards`?",
        "rewards+=1": "`rewards+` must be a list, not 1",
        "blue0_ctrl.rewadrs+=[1]": "there is no `rewadrs` in `blue0_ctrl`",
    }.items():
        with pytest.raises(ConfigError) as caught:
            apply_overrides(tree, [wrong])
        assert words in str(caught.value)
