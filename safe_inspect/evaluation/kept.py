"""`kept_episodes`: stores the batches of a long evaluation on disk, so that it can continue after an interruption."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from safe_inspect.errors import OutputError
from safe_inspect.evaluation.episodes import AgentEpisodes, Episodes
from safe_inspect.evaluation.recorder import Trajectory
from safe_inspect.evaluation.results.files import UNREADABLE_PACKED, load_packed, save_packed
from safe_inspect.evaluation.task import differing_keys
from safe_inspect.outputs import LOCK, NO_SPACE, cannot_write, exclusive, mark_folder, read_marker, remove_written

_NEW = "batch.new.npz"


class KeptEpisodes:
    """Stored batches of one rollout.

    A damaged batch is run again. On a full disk no further batches are stored, and the rollout continues.

    Args:
        folder: Their folder; None: nothing is stored.
        name: Prefix of the names of their files.
    """

    def __init__(self, folder: Path | None = None, name: str = "") -> None:
        self._folder, self._name = folder, name
        self.count = 0

    def get(self, first: int, count: int) -> Episodes | None:
        """Return a stored batch, given its first episode and its size; None if it has to be run."""
        if self._folder is None:
            return None
        try:
            found = load_packed(self._folder / _batch_file(self._name, first), Episodes, AgentEpisodes, Trajectory)
        except UNREADABLE_PACKED:
            return None
        if not isinstance(found, Episodes) or len(found) != count:
            return None
        self.count += count
        return found

    def add(self, first: int, batch: Episodes) -> None:
        """Store a batch; it is on the disk when this returns.

        Raises:
            OutputError: The batch cannot be written.
        """
        if self._folder is None:
            return
        try:
            save_packed(self._folder / _NEW, batch)
            (self._folder / _NEW).replace(self._folder / _batch_file(self._name, first))
        except OSError as error:
            with suppress(OSError):
                (self._folder / _NEW).unlink()
            if error.errno not in NO_SPACE:
                raise cannot_write(self._folder, error, "give another with --output", "folder") from None
            self._folder = None
            return
        self.count += len(batch)


@contextmanager
def kept_episodes(
    output: Path | None, command: str, flights: Mapping[str, Mapping[str, Any]], *, num_envs: int, force: bool = False
) -> Iterator[list[KeptEpisodes]]:
    """Provide the stored batches of each rollout, in a folder next to `output` whose name ends in ``.part``.

    The folder is removed when the block ends without an error, and when nothing was stored. After any error the batches
    stay, and a note of the error says so.

    Args:
        output: Path of the evaluations to be written; None: nothing is stored.
        command: The command that runs the rollouts.
        flights: For each rollout its name, and a mapping of everything that determines its episodes, with their number
            under ``episodes``.
        num_envs: Number of episodes in a batch.
        force: Whether the episodes of other rollouts are replaced.

    Raises:
        OutputError: The folder contains episodes of other rollouts or something else, it cannot be written, or another
            process is writing episodes to it.
    """
    if output is None:
        yield [KeptEpisodes() for _ in flights]
        return
    shown = output.with_name(f"{output.name}.part")
    folder = shown.expanduser().absolute()
    flown = json.loads(json.dumps({"num_envs": num_envs, "flights": flights}, default=str))
    total = sum(int(flight["episodes"]) for flight in flights.values())
    files = {_NEW}
    for name, flight in flights.items():
        files |= {_batch_file(name, first) for first in range(0, int(flight["episodes"]), num_envs)}
    with ExitStack() as stack:
        try:
            if folder.exists() and (read_marker(folder)["command"] != command or folder.is_symlink()):
                raise OutputError(
                    f"{folder}: the folder is not from an interrupted `{command}`; give another with --output"
                )
            folder.mkdir(parents=True, exist_ok=True)
            stack.enter_context(exclusive(folder, "flying episodes into"))
            _check_flights(folder, command, flown, force)
            mark_folder(folder, command, files, flown=flown)
        except OutputError:
            raise
        except OSError as error:
            if error.errno not in NO_SPACE:
                raise cannot_write(output, error, "give another with --output", "folder") from None
            remove_written(folder)
            yield [KeptEpisodes() for _ in flights]
            return
        kept = [KeptEpisodes(folder, name) for name in flights]
        try:
            yield kept
        except BaseException as error:
            count = sum(each.count for each in kept)
            if not count:
                remove_written(folder)
            if isinstance(error, KeyboardInterrupt):
                error.add_note(
                    f"{count:,} of {total:,} episodes are kept in {shown}; run the same command to continue"
                    if count
                    else f"nothing is kept, as the first batch of {min(num_envs, total):,} episodes was not complete"
                )
            elif count:
                error.add_note(
                    f"{count:,} of {total:,} episodes are kept in {shown}, and the same command continues with them; "
                    "delete the folder if you change code that they depend on"
                )
            raise
        remove_written(folder)


def _batch_file(name: str, first: int) -> str:
    """Return the file name of a batch."""
    return f"{name}-{first:08d}.npz"


def _check_flights(folder: Path, command: str, flown: Mapping[str, Any], force: bool) -> None:
    """Check that a folder contains batches of the same rollouts; with `force`, remove those of others.

    Raises:
        OutputError: The folder contains batches of other rollouts.
    """
    marker = read_marker(folder)
    differing = differing_keys(marker["flown"], flown) if "flown" in marker else []
    if differing and not force:
        keys = ", ".join(f"`{key.removeprefix('flights.')}`" for key in differing[:3])
        raise OutputError(
            f"{folder}: the folder has episodes of an interrupted `{command}` with other arguments (they differ in "
            f"{keys}); repeat its arguments to continue it, give another folder with --output, or start again with "
            "--force"
        )
    if differing:
        remove_written(folder, leave=(LOCK,))
