"""Starting and stopping Ray for a run, and rendezvous missions as Ray tasks, on this machine or on a cluster.

Ray prints nothing, writes to a separate folder, and leaves neither files nor processes behind.
"""

from __future__ import annotations

import math
import os
import secrets
import shutil
import signal
import socket
import sys
import tempfile
import time
import warnings
from collections.abc import Collection, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from safe_inspect.compiling import COMPILING_NOTE
from safe_inspect.errors import ConfigError, Problem
from safe_inspect.evaluation.missions import fly_mission
from safe_inspect.experiments.modules.run_folder import RunFolder
from safe_inspect.experiments.settings.translation import translate_ray
from safe_inspect.interrupts import STOPPING, Interrupted, deferred, handled
from safe_inspect.outputs import is_full

#: Longest path of Ray's folder [characters]. The system limits the paths of sockets in it to 107 bytes, of which Ray's
#: own part takes up to 67.
LONGEST_FOLDER = 40

_ENVIRONMENT = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
    "RAY_CHDIR_TO_TRIAL_DIR": "0",  # so that relative paths of a configuration are the same in every process
    "RAY_AIR_NEW_OUTPUT": "0",
    "RAY_agent_register_timeout_ms": "120000",  # for the processes that a node starts, see `patient_start`
    "RAY_worker_niceness": "0",  # with Ray's default of 15 a training gets a thirtieth of a shared core
    "TUNE_DISABLE_AUTO_CALLBACK_LOGGERS": "1",  # the run writes its own logs, see `TrainingLog`
    "TUNE_DISABLE_SIGINT_HANDLER": "1",
    "TUNE_WARN_EXCESSIVE_EXPERIMENT_CHECKPOINT_SYNC_THRESHOLD_S": "0",
}

#: Prefixes of the names of Ray's logs that are kept after a failed training.
_LOGS = ("worker-", "raylet", "python-core-driver")

#: Resources of Ray: their name in messages, the key of `ray_config`, and a hint.
_SCARCE = {
    "CPU": (
        "processors",
        "num_cpus",
        "lower `num_env_runners` or `num_cpus_per_env_runner` in rllib_configs, or raise `num_cpus`",
    ),
    "GPU": (
        "GPUs",
        "num_gpus",
        "lower `num_gpus_per_learner` or `num_gpus_per_env_runner` in rllib_configs, or train where there are GPUs",
    ),
}

#: Longest time that a local Ray may take to start [s].
_LONGEST_START = 120.0

_token = ""


class Claim(NamedTuple):
    """What a run needs.

    Attributes:
        resources: Amount of each resource by Ray's name of it, such as CPU or GPU.
        processes: Number of processes.
    """

    resources: Mapping[str, float]
    processes: int = 1


def largest_claim(trials: Collection[Sequence[Mapping[str, float]]]) -> Claim:
    """Return what the largest trial of a training needs, for each resource separately.

    Args:
        trials: For each trial, the resources of each of its processes.
    """
    names = sorted({name for processes in trials for process in processes for name in process})
    resources = {
        name: max(sum(process.get(name, 0.0) for process in processes) for processes in trials) for name in names
    }
    return Claim(resources, max(map(len, trials)))


def set_environment() -> None:
    """Set the environment variables that Ray reads; must be called before Ray is imported."""
    for name, value in _ENVIRONMENT.items():
        os.environ.setdefault(name, value)


@contextmanager
def ray_cluster(settings: Mapping[str, Any], claim: Claim, folder: RunFolder | None) -> Iterator[None]:
    """Provide Ray within a context.

    A Ray that this process has already started is used and left running, as is the cluster that `address` names.
    Otherwise Ray is started for this run and stopped at its end.

    Args:
        settings: From `translate_ray`.
        claim: What the run needs.
        folder: The run's folder, which records the path of Ray's folder and receives Ray's logs if the run fails. None
            for a run without a folder.

    Raises:
        ConfigError: The cluster cannot be reached, or is too small.
    """
    import ray

    if ray.is_initialized():
        check_size(claim, _resources())
        yield
        return
    common = {
        key: settings[key] for key in ("log_to_driver", "namespace", "runtime_env") if settings.get(key) is not None
    } | {"logging_level": settings["logging_level"].upper()}
    address = settings.get("address") or "local"
    if address != "local":
        yield from _attached(address, common, claim)
        return
    check_given(claim, settings)
    cpus, machine = claim.resources.get("CPU", 0.0), os.cpu_count() or 1
    available = settings.get("num_cpus") or max(machine, math.ceil(cpus))
    if cpus > machine:
        shared = f"the training claims {cpus:g} processors, but this machine has {machine}; its processes share them "
        remedy = (
            f"({claim.processes}, of about 0.5 GB each); if it is too slow, lower `num_env_runners` in rllib_configs"
        )
        warnings.warn(shared + remedy, stacklevel=4)
    temporary = _temporary_folder(settings.get("temporary_folder"))
    if folder is not None:
        _remove_leftovers(folder)
        folder.ray_note.write_text(str(temporary), encoding="utf-8")
    names = ("num_gpus", "resources", "include_dashboard", "dashboard_host", "dashboard_port")
    local = {key: settings[key] for key in names if settings.get(key) is not None}
    try:
        with _inherited(_for_processes(folder)):
            with _outliving_signals(), patient_start():
                ray.init(
                    address="local",
                    num_cpus=int(available),
                    object_store_memory=settings.get("object_store_memory") or 256 * 2**20,
                    _temp_dir=str(temporary),
                    **local,
                    **common,
                )
            check_size(claim, _resources())
            yield
    except Exception:
        if folder is not None and not is_full(folder.path):
            _keep_logs(temporary, folder.path / "ray_logs")
        raise
    finally:
        with handled(lambda _: None):  # signals are ignored, because the run is already ending
            _shut_down()
            shutil.rmtree(temporary, ignore_errors=True)
            if folder is not None:
                folder.ray_note.unlink(missing_ok=True)


@contextmanager
def patient_start() -> Iterator[None]:
    """Allow a local Ray two minutes to start on a busy machine; by default Ray gives up after half a minute."""
    from ray._private import services

    get_node: Any = getattr(services, "get_node", None)
    if get_node is None:  # this release of Ray has no such function
        yield
        return

    def wait_for_node(*arguments: Any, **keywords: Any) -> Any:
        deadline = time.monotonic() + _LONGEST_START
        while True:
            try:
                return get_node(*arguments, **keywords)
            except RuntimeError:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.2)

    services.get_node = wait_for_node
    try:
        yield
    finally:
        services.get_node = get_node


def _shut_down() -> None:
    """Stop the local Ray and all processes that it has started.

    Ray sends SIGTERM, which is blocked in its processes (`_outliving_signals`), and waits for a second before it kills
    each of them. Only the raylet gets this second, in which the workers of the run end; the other processes are idle.
    The agents of the raylet would search for their cluster for up to a minute, so those that remain are killed.
    """
    import psutil  # a dependency of Ray
    import ray

    node: Any = getattr(ray._private.worker, "_global_node", None)
    kill = getattr(node, "_kill_process_type", None)
    started: list[Any] = []
    if kill is not None:

        def kill_at_once(process_type: str, **keywords: Any) -> None:
            if process_type != "raylet":
                keywords["allow_graceful"] = False
            kill(process_type, **keywords)

        node._kill_process_type = kill_at_once
        for process in (info.process for kind in node.all_processes.values() for info in kind):
            with suppress(psutil.Error):
                started += psutil.Process(process.pid).children(recursive=True)
    ray.shutdown()
    for child in started:
        with suppress(psutil.Error):  # the process has already ended
            child.kill()
    psutil.wait_procs(started, timeout=5.0)


@contextmanager
def _outliving_signals() -> Iterator[None]:
    """Block SIGTERM and SIGHUP in the processes that are started within the context, and in their child processes.

    Terminals, `timeout`, batch schedulers and systemd send these signals to all processes of the group or of the job,
    but Ray's processes must run until the last checkpoint is saved. Ray itself blocks SIGINT in them in the same way.
    """
    blocked = [number for number in STOPPING if number != signal.SIGINT] if os.name == "posix" else []
    before = signal.pthread_sigmask(signal.SIG_BLOCK, blocked) if blocked else None
    try:
        with deferred():  # Ray cannot be interrupted while it starts, and installs its own handler for SIGTERM
            yield
    except SystemExit:  # raised by that handler
        raise Interrupted(signal.SIGTERM) from None
    finally:
        if before is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _attached(address: str, common: Mapping[str, Any], claim: Claim) -> Iterator[None]:
    import ray

    try:
        found = _started_cluster() if address == "auto" else address
        _knock(found)
        ray.init(address=found, **common)
    except (OSError, RuntimeError) as error:
        cause = error.__cause__ or error
        reason = next((line for line in reversed(str(cause).splitlines()) if line.strip()), type(cause).__name__)
        message = f"no Ray cluster at `{address}` can be joined ({reason.strip()})"
        hint = "start one with `ray start --head`, set RAY_AUTH_MODE=token if it requires a token, or remove `address`"
        raise ConfigError(Problem(message, "ray_config.address", hint=hint)) from error
    try:
        check_size(claim, _resources())
        yield
    finally:
        ray.shutdown()  # disconnects from the cluster without stopping it


def _started_cluster() -> str:
    """Return the address of the cluster that RAY_ADDRESS names, or that ``ray start`` has started on this machine.

    Ray itself would search all processes of the machine, including the private Rays of other trainings.

    Raises:
        OSError: There is no such cluster.
    """
    from ray._private.utils import read_ray_address

    address = os.environ.get("RAY_ADDRESS", "")
    if address and address not in ("auto", "local"):
        return address
    noted: str | None = read_ray_address()
    if not noted:
        raise OSError("RAY_ADDRESS is not set, and `ray start` has started none on this machine")
    return noted


def _knock(address: str) -> None:
    """Raise OSError if nothing listens at an address, because Ray itself would retry for minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host and port.isdigit():
        socket.create_connection((host, int(port)), timeout=5.0).close()


def _for_processes(folder: RunFolder | None) -> dict[str, str]:
    """Return the environment variables for the processes of a local Ray: import path, compiling note and token.

    Ray protects its local cluster with a token that it writes to the home folder, which may not be writable.
    """
    global _token
    found = {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    if folder is not None:
        found[COMPILING_NOTE] = str(folder.compiling_note)
    own = any(name.startswith("RAY_AUTH_") for name in os.environ) or (Path.home() / ".ray" / "auth_token").exists()
    if _token or not own:
        _token = _token or secrets.token_hex(32)  # one token per process, because Ray reads it only once
        found["RAY_AUTH_TOKEN"] = _token
    return found


@contextmanager
def _inherited(variables: Mapping[str, str]) -> Iterator[None]:
    """Set environment variables within a context, and restore the previous values afterwards."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _resources() -> dict[str, float]:
    import ray

    found: dict[str, float] = ray.cluster_resources()  # type: ignore[no-untyped-call]
    return found


def check_given(claim: Claim, settings: Mapping[str, Any]) -> None:
    """Raise ConfigError if the keys of `ray_config` give a local Ray less than a training needs.

    Args:
        claim: What the training needs.
        settings: From `translate_ray`. Ray finds the resources without a key when it starts.
    """
    given = {"CPU": settings.get("num_cpus") or None, "GPU": settings.get("num_gpus")}
    available = {name: amount for name, amount in given.items() if amount is not None}
    available |= settings.get("resources") or {}
    check_size(Claim({name: amount for name, amount in claim.resources.items() if name in available}), available)


def check_size(claim: Claim, available: Mapping[str, float]) -> None:
    """Raise ConfigError if Ray has too little of a resource for a training, because Tune would wait for it forever."""
    for name, needed in claim.resources.items():
        has = available.get(name, 0.0)
        if needed > has:
            other = (f"`{name}`", "resources", "lower it in rllib_configs, or add it to `resources`")
            units, key, hint = _SCARCE.get(name, other)
            units = units.removesuffix("s") if needed == 1 else units
            message = f"the training needs {needed:g} {units}, but Ray has {has:g}"
            raise ConfigError(Problem(message, f"ray_config.{key}", hint=hint))


def _temporary_folder(parent: str | None) -> Path:
    if parent is None:
        base = Path(tempfile.gettempdir())
        base = base if len(str(base)) + 12 <= LONGEST_FOLDER else Path("/tmp")
    else:
        base = Path(parent).expanduser().absolute()
        base.mkdir(parents=True, exist_ok=True)
    path = Path(tempfile.mkdtemp(prefix="si-", dir=base))
    if len(str(path)) > LONGEST_FOLDER and os.name == "posix":
        path.rmdir()
        message = f"the folder {base} is too long for Ray's sockets ({LONGEST_FOLDER - 12} characters at most)"
        raise ConfigError(Problem(message, "ray_config.temporary_folder", hint="give a short one, such as /tmp"))
    return path


def _remove_leftovers(folder: RunFolder) -> None:
    """Remove the folder of Ray that a killed attempt of this run has left; its processes ended with that attempt."""
    if folder.ray_note.is_file():
        old = Path(folder.ray_note.read_text(encoding="utf-8").strip() or "-")
        if old.name.startswith("si-") and (old / "session_latest").is_symlink():  # made by Ray
            shutil.rmtree(old, ignore_errors=True)


def _keep_logs(temporary: Path, target: Path) -> None:
    """Copy Ray's logs; if that fails they are omitted, so that the user sees the error of the training."""
    try:
        for path in (temporary / "session_latest" / "logs").glob("*"):
            if path.is_file() and path.stat().st_size and path.name.startswith(_LOGS):
                target.mkdir(exist_ok=True)
                shutil.copyfile(path, target / path.name)
    except OSError:
        shutil.rmtree(target, ignore_errors=True)


@dataclass(frozen=True)
class RayFlights:
    """Runner of missions as Ray tasks, each of which uses one processor.

    Only the process that started the tasks writes files. The nodes of a cluster need this package, but no shared disk.

    Attributes:
        address: ``auto`` or the address of a running cluster to join; ``local`` starts Ray on this machine.
        workers: Number of missions that run at the same time.
    """

    address: str
    workers: int

    def __call__(
        self, tree: dict[str, Any], source: str, numbers: Sequence[int]
    ) -> Generator[tuple[int, dict[str, Any]], None, None]:
        """Run missions and yield the number and the result of each as it ends.

        Args:
            tree: The resolved configuration of the missions.
            source: The file from which the configuration was loaded.
            numbers: The numbers of the missions.

        Raises:
            ConfigError: The cluster cannot be reached.
        """
        set_environment()
        import ray  # slow to import

        settings = translate_ray({"address": self.address, "num_cpus": self.workers}).settings
        with ray_cluster(settings, Claim({"CPU": 1.0}), None):
            fly = ray.remote(num_cpus=1)(fly_mission)
            shared = ray.put(tree)
            missing = list(reversed(numbers))
            flying: list[Any] = []
            try:
                while missing or flying:
                    while missing and len(flying) < self.workers:
                        flying.append(fly.remote(shared, source, missing.pop()))
                    done, flying = ray.wait(flying)
                    yield ray.get(done[0])
            except ray.exceptions.RayTaskError as error:
                raise error.cause from None  # omits the traceback of the worker
            finally:
                for task in flying:
                    ray.cancel(task, force=True)
