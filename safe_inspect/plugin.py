"""The former name of `safe_inspect.plugins`, kept for a release."""

from safe_inspect.plugins import *  # noqa: F403
