"""Start and stop Ray for a run: quiet, in a folder of its own, and with nothing left behind."""

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
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from safe_inspect.compiling import COMPILING_NOTE
from safe_inspect.errors import ConfigError, Problem
from safe_inspect.experiments.files.run_folder import RunFolder
from safe_inspect.interrupts import STOPPING, Interrupted, deferred, handled
from safe_inspect.outputs import is_full

#: Ray makes sockets in its folder, whose paths the system limits to 107 bytes; its own part takes up to 67.
LONGEST_FOLDER = 40

_ENVIRONMENT = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
    "RAY_CHDIR_TO_TRIAL_DIR": "0",  # relative paths of a configuration mean the same in every process
    "RAY_AIR_NEW_OUTPUT": "0",
    "RAY_agent_register_timeout_ms": "120000",  # of the processes that a node starts; see `patient_start`
    "RAY_worker_niceness": "0",  # Ray's 15 leaves a training a thirtieth of a core that somebody shares
    "TUNE_DISABLE_AUTO_CALLBACK_LOGGERS": "1",  # the run writes better logs, see training_log
    "TUNE_DISABLE_SIGINT_HANDLER": "1",
    "TUNE_WARN_EXCESSIVE_EXPERIMENT_CHECKPOINT_SYNC_THRESHOLD_S": "0",
}

#: How the names of those logs begin that a failed training keeps.
_LOGS = ("worker-", "raylet", "python-core-driver")

#: For how long a local Ray may start [s].
_LONGEST_START = 120.0

_token = ""


def set_environment() -> None:
    """Set what Ray reads from the environment; call it before Ray is imported."""
    for name, value in _ENVIRONMENT.items():
        os.environ.setdefault(name, value)


@contextmanager
def ray_cluster(settings: Mapping[str, Any], cpus: float, folder: RunFolder | None) -> Iterator[None]:
    """Provide Ray for as long as the context lasts.

    A Ray that this process has started already is used and left running; so is a cluster to
    which `address` points. Otherwise Ray is started for this run and stopped at its end.

    Args:
        settings: From `translate_ray`.
        cpus: How many logical processors the run claims.
        folder: The run's folder, in which Ray's own is noted; its logs are copied there when the run fails. None for
            a run without one.

    Raises:
        ConfigError: The cluster cannot be reached, or is too small.
    """
    import ray

    if ray.is_initialized():
        check_size(cpus, _processors())
        yield
        return
    common = {
        key: settings[key] for key in ("log_to_driver", "namespace", "runtime_env") if settings.get(key) is not None
    } | {"logging_level": settings["logging_level"].upper()}
    address = settings.get("address") or "local"
    if address != "local":
        yield from _attached(address, common, cpus)
        return
    available = settings.get("num_cpus") or max(os.cpu_count() or 1, math.ceil(cpus))
    check_size(cpus, available)
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
            yield
    except Exception:
        if folder is not None and not is_full(folder.path):
            _keep_logs(temporary, folder.path / "ray_logs")
        raise
    finally:
        with handled(lambda _: None):  # it ends already
            _shut_down()
            shutil.rmtree(temporary, ignore_errors=True)
            if folder is not None:
                folder.ray_note.unlink(missing_ok=True)


@contextmanager
def patient_start() -> Iterator[None]:
    """Let a local Ray take two minutes to start where the machine is busy; Ray itself gives up after half a minute."""
    from ray._private import services

    get_node: Any = getattr(services, "get_node", None)
    if get_node is None:  # another release of Ray
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
    """Stop the local Ray and all that it has started.

    Ray sends SIGTERM, which its processes do not see (`_outliving_signals`), and waits for a second before it kills
    each of them. Only the raylet is given that second, in which the workers of the run end; the others are idle. Agents
    of the raylet would look for their cluster for up to a minute: those that are left are killed.
    """
    import psutil  # Ray brings it
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
        with suppress(psutil.Error):  # it has ended
            child.kill()
    psutil.wait_procs(started, timeout=5.0)


@contextmanager
def _outliving_signals() -> Iterator[None]:
    """Start processes that only end with this one: SIGTERM and SIGHUP are blocked in them and in what they start.

    Terminals, `timeout`, batch schedulers and systemd send the signals to all processes of the group or of the job.
    Ray's have to live until the last checkpoint is saved. Ray itself blocks SIGINT in them, in the same way.
    """
    blocked = [number for number in STOPPING if number != signal.SIGINT] if os.name == "posix" else []
    before = signal.pthread_sigmask(signal.SIG_BLOCK, blocked) if blocked else None
    try:
        with deferred():  # Ray cannot be interrupted while it starts, and sets a handler of its own for SIGTERM
            yield
    except SystemExit:  # that handler's
        raise Interrupted(signal.SIGTERM) from None
    finally:
        if before is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _attached(address: str, common: Mapping[str, Any], cpus: float) -> Iterator[None]:
    import ray

    try:
        found = _started_cluster() if address == "auto" else address
        _knock(found)
        ray.init(address=found, **common)
    except (OSError, RuntimeError) as error:
        cause = error.__cause__ or error
        reason = next((line for line in reversed(str(cause).splitlines()) if line.strip()), type(cause).__name__)
        message = f"no Ray cluster at `{address}` can be joined ({reason.strip()})"
        hint = (
            "start one with `ray start --head`, set RAY_AUTH_MODE=token where it asks for a token, or remove `address`"
        )
        raise ConfigError(Problem(message, "ray_config.address", hint=hint)) from error
    try:
        check_size(cpus, _processors())
        yield
    finally:
        ray.shutdown()  # leaves the cluster; it is never stopped


def _started_cluster() -> str:
    """Return the address of the cluster that RAY_ADDRESS names, or that ``ray start`` has begun on this machine.

    Ray itself would look through the processes of the machine, among them the private Rays of other trainings.

    Raises:
        OSError: There is none.
    """
    from ray._private.utils import read_ray_address

    address = os.environ.get("RAY_ADDRESS", "")
    if address and address not in ("auto", "local"):
        return address
    noted: str | None = read_ray_address()
    if not noted:
        raise OSError("RAY_ADDRESS is not set, and `ray start` has begun none on this machine")
    return noted


def _knock(address: str) -> None:
    """Look whether anyone listens at an address: Ray itself would try for minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host and port.isdigit():
        socket.create_connection((host, int(port)), timeout=5.0).close()


def _for_processes(folder: RunFolder | None) -> dict[str, str]:
    """Return what the processes of a local Ray inherit: where to import from, where to note that they compile, a token.

    Ray guards its local cluster with a token that it writes into the home folder, which may not be ours to write.
    """
    global _token
    found = {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    if folder is not None:
        found[COMPILING_NOTE] = str(folder.compiling_note)
    own = any(name.startswith("RAY_AUTH_") for name in os.environ) or (Path.home() / ".ray" / "auth_token").exists()
    if _token or not own:
        _token = _token or secrets.token_hex(32)  # one for the process: Ray reads it once
        found["RAY_AUTH_TOKEN"] = _token
    return found


@contextmanager
def _inherited(variables: Mapping[str, str]) -> Iterator[None]:
    """Set variables of the environment for as long as the context lasts."""
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


def _processors() -> float:
    import ray

    resources: dict[str, float] = ray.cluster_resources()  # type: ignore[no-untyped-call]
    return float(resources.get("CPU", 0.0))


def check_size(needed: float, available: float) -> None:
    """Refuse what would wait for ever: Tune only starts a training that fits."""
    if needed > available:
        message = f"the training claims {needed:g} processors, and Ray has {available:g}"
        hint = "lower `num_env_runners` or `num_cpus_per_env_runner` in rllib_configs, or raise `num_cpus`"
        raise ConfigError(Problem(message, "ray_config.num_cpus", hint=hint))


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
    """Remove the folder that a killed attempt of this run has left; its processes have ended with it."""
    if folder.ray_note.is_file():
        old = Path(folder.ray_note.read_text(encoding="utf-8").strip() or "-")
        if old.name.startswith("si-") and (old / "session_latest").is_symlink():  # Ray made it
            shutil.rmtree(old, ignore_errors=True)


def _keep_logs(temporary: Path, target: Path) -> None:
    """Copy Ray's logs; where that fails they are left out, so that the error of the training is the one to be seen."""
    try:
        for path in (temporary / "session_latest" / "logs").glob("*"):
            if path.is_file() and path.stat().st_size and path.name.startswith(_LOGS):
                target.mkdir(exist_ok=True)
                shutil.copyfile(path, target / path.name)
    except OSError:
        shutil.rmtree(target, ignore_errors=True)
