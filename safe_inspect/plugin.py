"""The former name of `safe_inspect.plugins`, available for one more release."""

from safe_inspect.plugins import *  # noqa: F403
