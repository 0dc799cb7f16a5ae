"""The arguments that environments are made with, and the names of agents: one message that says what is meant."""

from __future__ import annotations

import gymnasium
import pytest

import safe_inspect
from safe_inspect.errors import AgentError, ArgumentError, ConfigError, PluginValueError
from safe_inspect.interrupts import Interrupted
from safe_inspect.rewards import Reward

ID = "safe_inspect/TranslationalInspection-v1"
TEAM = "safe_inspect/MultiagentTranslationalInspection-v1"


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"horizon": 5}, r"takes no keyword 'horizon'; .* overrides=\['horizon=5'\]$"),
        ({"gamm": 0.9}, r"takes no keyword 'gamm'; did you mean `gamma`\?$"),
        ({"enabled": True}, r"takes no keyword 'enabled'; .*`enabled` fits 3 places; write one of `RTAGlueCWH"),
    ],
)
def test_a_keyword_that_is_not_taken_is_told_what_it_may_mean(keywords, message):
    with pytest.raises(ArgumentError, match=message):
        gymnasium.make(ID, **keywords)


@pytest.mark.parametrize("gamma", ["a", None, True, 1.5, float("nan")])
def test_a_discount_is_a_number_from_0_to_1(gamma):
    for made in (safe_inspect.make, safe_inspect.make_vec, safe_inspect.make_parallel):
        with pytest.raises(ArgumentError, match="gamma: a number from 0 to 1 is expected"):
            made(ID, gamma=gamma)


@pytest.mark.parametrize("slot", ["a", -1, 0.5, float("inf")])
def test_a_slot_is_a_whole_number(slot):
    with pytest.raises(ArgumentError, match=r"^slot: a whole number from 0"):
        safe_inspect.make(ID, slot=slot)
    with pytest.raises(ArgumentError, match=r"^first_slot: a whole number from 0"):
        safe_inspect.make_vec(ID, first_slot=slot)


@pytest.mark.parametrize("overrides", ["horizon=5", {"horizon": 5}, [("horizon", 5)], 5])
def test_overrides_are_a_list_of_texts(overrides):
    with pytest.raises(ArgumentError, match=r'such as \["horizon=600"\]'):
        safe_inspect.make(ID, overrides)


def test_a_mistyped_autoreset_mode_is_told_the_nearest():
    with pytest.raises(ArgumentError, match=r"'nextstep'; did you mean `NextStep`"):
        safe_inspect.make_vec(ID, 2, autoreset_mode="nextstep")


def test_options_that_are_no_dictionary_are_refused():
    with pytest.raises(ArgumentError, match="a dictionary is expected, not 5"):
        safe_inspect.make(ID).reset(options=5)


@pytest.mark.parametrize("space", ["observation_space", "action_space"])
def test_an_unknown_agent_is_told_the_known_ones(space):
    with pytest.raises(AgentError, match="named 'nobody'; known: `blue0_ctrl`"):
        getattr(safe_inspect.make_parallel(TEAM), space)("nobody")


class Ends(Reward):
    """Raises what a test asks for."""

    what: str

    def __call__(self, step):
        if self.what == "deep":
            return self(step)
        ends = {"exit": SystemExit(3), "generator": GeneratorExit(), "interrupt": KeyboardInterrupt()}
        raise ends.get(self.what, Interrupted(2))


def ended(what):
    environment = safe_inspect.make(ID, [f"rewards=[{{functor: {__name__}.Ends, config: {{what: {what}}}}}]"])
    environment.reset(seed=0)
    return environment.step(environment.action_space.sample())


@pytest.mark.parametrize(
    ("what", "told"), [("generator", "raises GeneratorExit"), ("deep", "calls itself without end")]
)
def test_a_plugin_that_ends_otherwise_is_named(what, told):
    with pytest.raises(PluginValueError, match=rf"the reward Ends {told} \({__file__}:\d+: ") as error:
        ended(what)
    assert error.value.__suppress_context__  # of a thousand calls


@pytest.mark.parametrize("cfg", [None, 3, "", {"agent_config": {}}])
def test_what_is_no_configuration_is_refused(cfg):
    for make in (safe_inspect.make, safe_inspect.make_vec, safe_inspect.make_parallel):
        with pytest.raises(ConfigError, match="is the path of a file or the id of a task, not"):
            make(cfg)


def test_a_plugin_that_ends_the_program_is_named():
    with pytest.raises(PluginValueError, match=rf"the reward Ends ends the program \({__file__}:\d+: raise"):
        ended("exit")


def test_a_plugin_that_raises_keyboard_interrupt_is_named_and_a_signal_is_not():
    with pytest.raises(KeyboardInterrupt) as raised:
        ended("interrupt")
    assert "raised in the reward Ends" in raised.value.__notes__[0]
    with pytest.raises(Interrupted) as stopped:
        ended("signal")
    assert not hasattr(stopped.value, "__notes__")
