"""Checks of the arguments with which the façades make environments."""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Iterable, Mapping
from numbers import Integral, Real
from os import PathLike
from typing import Any

from gymnasium.vector import AutoresetMode

from safe_inspect.config.experiment import load_experiment
from safe_inspect.config.keys.other_words import OTHER_WORDS
from safe_inspect.errors import ArgumentError, ConfigError, KeywordError, did_you_mean

#: Largest first slot, so that all slots of a batch fit in 64 bits.
_LAST_SLOT = 2**62


def checked_gamma(gamma: Any) -> float:
    """Return the discount per control step.

    Raises:
        ArgumentError: The discount is not a number from 0 to 1.
    """
    if isinstance(gamma, bool) or not isinstance(gamma, Real) or not 0.0 <= float(gamma) <= 1.0:
        raise ArgumentError(f"gamma: a number from 0 to 1 is expected, not {gamma!r}")
    return float(gamma)


def checked_slot(slot: Any, name: str) -> int:
    """Return the index of an environment slot.

    Raises:
        ArgumentError: The slot is not a whole number, is below 0, or is too large.
    """
    if isinstance(slot, bool) or not isinstance(slot, Integral) or not 0 <= int(slot) <= _LAST_SLOT:
        raise ArgumentError(f"{name}: a whole number from 0 to 2**62 is expected, not {slot!r}")
    return int(slot)


def checked_overrides(overrides: Any) -> list[str]:
    """Return overrides as a list.

    Raises:
        ArgumentError: The overrides are a single string or a mapping, or contain something other than strings.
    """
    hint = 'a list of strings is expected, such as ["horizon=600"]'
    if isinstance(overrides, str | Mapping) or not isinstance(overrides, Iterable):
        raise ArgumentError(f"overrides: {hint}, not {overrides!r}")
    given = list(overrides)
    wrong = next((override for override in given if not isinstance(override, str)), None)
    if wrong is not None:
        raise ArgumentError(f"overrides: {hint}; {wrong!r} is not a string")
    return given


def checked_autoreset(mode: Any) -> AutoresetMode:
    """Return the mode that sets when ended environments are reset.

    Raises:
        ArgumentError: There is no such mode.
    """
    try:
        return AutoresetMode(mode)
    except ValueError:
        known = [known.value for known in AutoresetMode]
        raise ArgumentError(f"autoreset_mode: there is no mode {mode!r}; {did_you_mean(str(mode), known)}") from None


def check_keywords(
    made: type[Any], given: Mapping[str, Any], cfg: str | PathLike[str], overrides: Iterable[str]
) -> None:
    """Check that an environment class accepts the given keywords.

    Raises:
        KeywordError: A keyword is not accepted; for a key of the configuration, the message shows the override.
    """
    taken = [*list(inspect.signature(made).parameters)[1:], "overrides"]  # the first is the task
    problems = []
    for name in given:
        if name in taken:
            continue
        hint = did_you_mean(name, taken)
        override = f"{OTHER_WORDS.get(name, name)}={given[name]}"
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                load_experiment(cfg, [*overrides, override])
            hint = f"a value of the configuration is replaced by overrides=[{override!r}]"
        except ConfigError as error:
            if "fits" in str(error):  # several keys of the configuration have the name
                hint = f"as an override, {error}"
        problems.append(f"{made.__name__}() got an unexpected keyword argument {name!r}; {hint}")
    if problems:
        raise KeywordError("\n".join(problems))
