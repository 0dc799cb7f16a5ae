"""The command ``safe-inspect schema``."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from pydantic import BaseModel

from safe_inspect.cli.arguments import add_option
from safe_inspect.config.schema import FILES, model_schema
from safe_inspect.errors import ConfigError, did_you_mean
from safe_inspect.outputs import check_writable, new_file
from safe_inspect.rendezvous.experiment import RendezvousConfig

#: The model of each kind of file with a schema.
_SCHEMAS: dict[str, type[BaseModel]] = {**FILES, "rendezvous": RendezvousConfig}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``schema``."""
    add_option(parser, "file", "KIND", f"kind of file, one of: {', '.join(_SCHEMAS)}", default="experiment", nargs="?")
    add_option(parser, "--output", "FILE", "write the schema to this file (default: print it)", Path)


def run(arguments: argparse.Namespace) -> int:
    """Write the JSON schema of a configuration file, for editors.

    Editors use it for completion and for checks while you type.

    Example:
        safe-inspect schema agent --output agent.schema.json
    """
    if arguments.file not in _SCHEMAS:
        raise ConfigError(f"there is no kind of file {arguments.file!r}; {did_you_mean(arguments.file, _SCHEMAS)}")
    text = json.dumps(model_schema(_SCHEMAS[arguments.file]), indent=2, sort_keys=True)
    if arguments.output is None:
        print(text)
        return 0
    check_writable(arguments.output, [".json"])
    with new_file(arguments.output) as work:
        work.write_text(text + "\n", encoding="utf-8")
    return 0
