"""Progress of a training: one line for each iteration, and the files of the run.

A resumed run continues these files (progress.csv, result.json and the TensorBoard log): the entries that an earlier
attempt logged after the checkpoint from which the run continues are removed. (Tune's own logs start again with each
attempt, count TensorBoard's steps in iterations, drop columns that appear late, and repeat the whole configuration in
each line.)
"""

from __future__ import annotations

import csv
import json
import math
import threading
import time
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, TextIO

from safe_inspect.config.keys.run_keys import COMPILING, STOP_COUNTS
from safe_inspect.outputs import new_file

#: Columns of progress.csv, each with the path of the value in RLlib's result.
COLUMNS: dict[str, str] = {
    "iteration": "training_iteration",
    "steps": "num_env_steps_sampled_lifetime",
    "seconds": "time_total_s",
    "iteration_seconds": "time_this_iter_s",
    "episodes": "env_runners/num_episodes_lifetime",
    "return_mean": "env_runners/episode_return_mean",
    "return_min": "env_runners/episode_return_min",
    "return_max": "env_runners/episode_return_max",
    "length_mean": "env_runners/episode_len_mean",
    "success_rate": "env_runners/success_rate",
    "lost_rate": "env_runners/lost_rate",
    "inspected_fraction": "env_runners/inspected_fraction",
    "inspected_count": "env_runners/inspected_count",
    "delta_v": "env_runners/delta_v",
    "evaluation_return_mean": "evaluation/env_runners/episode_return_mean",
    "evaluation_success_rate": "evaluation/env_runners/success_rate",
    "evaluation_inspected_fraction": "evaluation/env_runners/inspected_fraction",
    "evaluation_delta_v": "evaluation/env_runners/delta_v",
}

_RUNNERS, _LEARNERS = "env_runners/", "learners/"
_SINGLE = "default_policy"
_LEARNER_VALUES = ("policy_loss", "vf_loss", "entropy", "mean_kl_loss", "vf_explained_var")
_ENDLESS = 1e15  # larger limits mean "no limit"; safe-autonomy-sims uses 9e18

_HIDDEN = ("timestamp", "pid", "seed", "iterations_since_restore", "time_since_restore")


def flatten(result: Mapping[str, Any], prefix: str = "") -> dict[str, float]:
    """Return the numbers of a nested result under paths such as ``env_runners/episode_return_mean``."""
    flat: dict[str, float] = {}
    for key, value in result.items():
        if isinstance(value, Mapping) and key != "config":
            flat |= flatten(value, f"{prefix}{key}/")
        elif not isinstance(value, bool | str):
            with suppress(TypeError, ValueError):
                flat[f"{prefix}{key}"] = float(value)
    return flat


def row_of(flat: Mapping[str, float]) -> dict[str, float]:
    """Return the row of progress.csv for a flattened result; values that are not known yet are NaN."""
    row = {column: flat.get(key, math.nan) for column, key in COLUMNS.items()}
    row |= {key.removeprefix(_RUNNERS): flat[key] for key in sorted(flat) if key.startswith(f"{_RUNNERS}reward/")}
    if f"{_RUNNERS}interventions" in flat:  # a safety filter is enabled
        row["interventions"] = flat[f"{_RUNNERS}interventions"]
    row |= {key.removeprefix(_RUNNERS): flat[key] for key in sorted(flat) if key.startswith(f"{_RUNNERS}agents/")}
    for key in sorted(flat):
        if key.startswith(_LEARNERS):
            policy, _, name = key.removeprefix(_LEARNERS).partition("/")
            if name in _LEARNER_VALUES:
                row[name if policy == _SINGLE else f"policies/{policy}/{name}"] = flat[key]
    return row


def time_left(stop: Mapping[str, float], now: Mapping[str, float], rates: Mapping[str, float]) -> float:
    """Return the estimated time until the first limit is reached [s]; infinite if no limit will be reached.

    Args:
        stop: Limits, by RLlib's names.
        now: Current values of the run, by the same names.
        rates: Increase of each value per second.
    """
    left = math.inf
    for key, limit in stop.items():
        if key in rates and rates[key] > 0.0 and limit < _ENDLESS:
            left = min(left, max(limit - now.get(key, 0.0), 0.0) / rates[key])
    return left


def clock_text(seconds: float) -> str:
    """Return a duration as hours, minutes and seconds, such as ``1:02:03``; ``-`` if it is not finite."""
    if not math.isfinite(seconds):
        return "-"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}"


class Messages:
    """Text stream that ignores errors, so that a training continues after its terminal is closed or its disk is full.

    Args:
        stream: The stream that receives the text.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write text and return its length."""
        with suppress(OSError, RuntimeError):  # RuntimeError if a signal interrupts a call of this method
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Write the buffered text."""
        with suppress(OSError, RuntimeError):
            self._stream.flush()


class Heartbeat:
    """Printer of status lines while a training prints nothing else: when it compiles, and every half minute.

    Args:
        stream: The stream to print to.
        note: The file that exists while a process of the training compiles.
    """

    _SILENCE = 28.0

    def __init__(self, stream: TextIO, note: Path) -> None:
        self._stream, self._note = stream, note
        self._began = self._last = time.monotonic()
        self._iterated = self._announced = False
        self._seen = 0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> None:
        self._note.unlink(missing_ok=True)
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self._note.unlink(missing_ok=True)

    def iteration(self) -> None:
        """Record that an iteration has ended and printed its line."""
        self._began = self._last = time.monotonic()
        self._iterated = True

    def beat(self) -> None:
        """Print a status line if one is due."""
        now, compiles = time.monotonic(), not self._iterated and self._note.exists()
        self._seen = self._seen + 1 if compiles else 0  # short compilations are not reported
        what = "the next iteration" if self._iterated else "the first iteration"
        if self._seen >= 2 and not self._announced:
            text = "compiling, once for each installation: up to some minutes on a busy machine ..."
        elif now - self._last >= self._SILENCE:
            text = f"working on {what}{', compiling' if compiles else ''}, for {clock_text(now - self._began)}"
        else:
            return
        self._announced |= self._seen >= 2
        self._last = now
        print(text, file=self._stream, flush=True)

    def _run(self) -> None:
        while not self._ended.wait(2.0):
            self.beat()


class TrainingProgress:
    """Printer of the iterations of a training.

    Args:
        stop: Limits at which the training ends, by RLlib's names.
        stream: The stream to print to.
        label: Printed before each line, to distinguish trials.
    """

    _TIMED = (*STOP_COUNTS, COMPILING)

    def __init__(self, stop: Mapping[str, float], stream: TextIO, label: str = "") -> None:
        self._stop = dict(stop)
        self._stream = stream
        self._label = f"{label}  " if label else ""
        self._recent: deque[dict[str, float]] = deque(maxlen=11)

    def show(self, flat: Mapping[str, float]) -> None:
        """Print the line of an iteration."""
        self._recent.append({key: flat.get(key, 0.0) for key in self._TIMED})
        print(self.line(flat), file=self._stream, flush=True)

    def line(self, flat: Mapping[str, float]) -> str:
        """Return the line of an iteration."""
        limit = self._stop.get("training_iteration", math.inf)
        total = f"/{limit:.0f}" if limit < _ENDLESS else ""
        points = "env_runners/inspected_fraction" in flat  # some tasks have no points to inspect
        rates = self._rates()
        return self._label + "  ".join(
            (
                f"iteration {flat.get('training_iteration', 0):>4.0f}{total}",
                f"steps {flat.get('num_env_steps_sampled_lifetime', 0):>10,.0f}",
                f"{rates['num_env_steps_sampled_lifetime']:>7,.0f}/s",
                f"return {_number(flat, 'episode_return_mean', '7.3f')}",
                f"success {_number(flat, 'success_rate', '3.0f', 100.0)} %",
                *([f"inspected {_number(flat, 'inspected_fraction', '3.0f', 100.0)} %"] if points else []),
                f"delta-v {_number(flat, 'delta_v', '6.2f')} m/s",
                f"left {clock_text(time_left(self._stop, flat, rates))}",
            )
        )

    def _rates(self) -> dict[str, float]:
        """Return the increases per second over the last ten iterations, excluding the time spent compiling."""
        first, last = self._recent[0], self._recent[-1]
        if len(self._recent) == 1:
            first = dict.fromkeys(self._TIMED, 0.0)
        seconds = last["time_total_s"] - first["time_total_s"] - (last[COMPILING] - first[COMPILING])
        return {key: (last[key] - first[key]) / seconds if seconds > 0.0 else 0.0 for key in self._TIMED}


def _number(flat: Mapping[str, float], name: str, form: str, scale: float = 1.0) -> str:
    value = flat.get(f"env_runners/{name}", math.nan)
    return f"{scale * value:{form}}" if math.isfinite(value) else "-".rjust(int(form.partition(".")[0]))


class TrainingLog:
    """Writer of the logs of one training.

    Args:
        folder: Folder of the files.
        iteration: The iteration from which the training continues; later rows are removed.
        steps: Number of environment steps at that iteration.
    """

    def __init__(self, folder: Path, iteration: int = 0, steps: int = 0) -> None:
        from tensorboardX import SummaryWriter  # type: ignore[import-untyped]

        folder.mkdir(parents=True, exist_ok=True)
        self._csv, self._json = folder / "progress.csv", folder / "result.json"
        self._rows = [row for row in read_progress(self._csv) if row["iteration"] <= iteration]
        self._columns = list(dict.fromkeys(column for row in self._rows for column in row))
        _keep_lines(self._json, iteration)
        self._write_rows()
        purge = steps + 1 if iteration else None
        self._board = SummaryWriter(str(folder / "tensorboard"), purge_step=purge, flush_secs=10)

    def add(self, flat: Mapping[str, float]) -> None:
        """Write the entries of an iteration, given its flattened result."""
        row = row_of(flat)
        self._rows.append(row)
        new = [column for column in row if column not in self._columns]
        self._columns += new
        if new:  # such as the reward terms, which are only known once the first episode has ended
            self._write_rows()
        else:
            with self._csv.open("a", newline="", encoding="utf-8") as file:
                csv.DictWriter(file, self._columns).writerow(_cells(row))
        with self._json.open("a", encoding="utf-8") as file:
            values = {key: value for key, value in flat.items() if math.isfinite(value)}
            file.write(json.dumps(values) + "\n")
        step = int(flat.get("num_env_steps_sampled_lifetime", 0))
        for key, value in flat.items():
            if math.isfinite(value) and key not in _HIDDEN:
                self._board.add_scalar(key if "/" in key else f"run/{key}", value, step)
        self._board.flush()

    def close(self) -> None:
        """Close the files."""
        self._board.close()

    def _write_rows(self) -> None:
        if not self._columns:
            self._csv.unlink(missing_ok=True)
            return
        with new_file(self._csv) as work, work.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, self._columns)
            writer.writeheader()
            writer.writerows(_cells(row) for row in self._rows)


def read_progress(path: Path) -> list[dict[str, float]]:
    """Return the rows of a progress.csv; an empty cell is NaN, and a row that a kill has truncated is omitted."""
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row.get("iteration") and None not in row.values()]
    return [{key: float(cell) if cell else math.nan for key, cell in row.items() if key is not None} for row in rows]


def _cells(row: Mapping[str, float]) -> dict[str, str]:
    return {key: f"{value:.10g}" if math.isfinite(value) else "" for key, value in row.items()}


def _keep_lines(path: Path, iteration: int) -> None:
    if not path.is_file():
        return
    kept = []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            if json.loads(line)["training_iteration"] <= iteration:
                kept.append(line + "\n")
        except (ValueError, KeyError):
            continue  # truncated by a kill
    with new_file(path) as work:
        work.write_text("".join(kept), encoding="utf-8")
