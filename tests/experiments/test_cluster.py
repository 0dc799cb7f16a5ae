"""Ray is started in a short folder of the run's own, or joined and left as it was."""

from __future__ import annotations

import errno
import os
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from safe_inspect.errors import ConfigError
from safe_inspect.experiments.modules.run_folder import RunFolder
from safe_inspect.experiments.runs import cluster
from safe_inspect.experiments.runs.cluster import Claim

HERE = Path(__file__).parent


def test_a_folder_too_long_for_rays_sockets_is_refused(tmp_path):
    parent = tmp_path / ("long" * 12)
    with pytest.raises(ConfigError, match=r"ray_config\.temporary_folder: .* too long for Ray's sockets"):
        cluster._temporary_folder(str(parent))
    assert not list(parent.iterdir())


def test_the_folder_is_short_wherever_the_system_puts_its_own(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / ("long" * 12)))
    folder = cluster._temporary_folder(None)
    assert len(str(folder)) <= cluster.LONGEST_FOLDER
    folder.rmdir()


@pytest.mark.parametrize(
    ("name", "of_ray", "gone"), [("si-abc", True, True), ("si-thesis", False, False), ("precious", True, False)]
)
def test_only_a_folder_of_ours_is_removed(tmp_path, name, of_ray, gone):
    (tmp_path / name).mkdir()
    if of_ray:
        (tmp_path / name / "session_latest").symlink_to("session_1")
    run = RunFolder(tmp_path)
    run.ray_note.write_text(str(tmp_path / name))
    cluster._remove_leftovers(run)
    assert (tmp_path / name).exists() is not gone


def test_a_training_that_would_wait_forever_is_refused():
    cluster.check_size(Claim({"CPU": 4.0}), {"CPU": 4.0})
    with pytest.raises(ConfigError, match=r"needs 4\.5 processors, but Ray has 4; lower `num_env_runners`"):
        cluster.check_size(Claim({"CPU": 4.5}), {"CPU": 4.0})


def test_logs_that_cannot_be_copied_do_not_hide_the_error(tmp_path, monkeypatch):
    logs = tmp_path / "ray" / "session_latest" / "logs"
    logs.mkdir(parents=True)
    (logs / "raylet.out").write_text("text")
    cluster._keep_logs(tmp_path / "ray", tmp_path / "kept")
    assert (tmp_path / "kept" / "raylet.out").read_text() == "text"

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(cluster.shutil, "copyfile", full)
    cluster._keep_logs(tmp_path / "ray", tmp_path / "kept")
    assert not (tmp_path / "kept").exists()


_CLUSTER = """
import sys, ray
context = ray.init(address="local", num_cpus=2, include_dashboard=False, _temp_dir=sys.argv[1])
print(context.address_info["gcs_address"], flush=True)
sys.stdin.readline()
print(ray.get(ray.remote(lambda: "alive").remote()), flush=True)
"""

_TRAINING = """
import sys, io
from pathlib import Path
from training_values import MAKER, QUICK
from safe_inspect.errors import ConfigError
from safe_inspect.experiments.runs.train import train
from safe_inspect.experiments.runs.training_run import TrainingRun
run = dict(rllib=QUICK, tune={"stop": {"training_iteration": 1}}, output=Path(sys.argv[2]), maker=MAKER)
print(train(TrainingRun({}, ray={"address": sys.argv[1]}, **run), io.StringIO()).iteration)
"""


@pytest.mark.ray
@pytest.mark.slow
def test_a_running_cluster_is_joined_and_left_running(tmp_path):
    environment = {key: value for key, value in os.environ.items() if not key.startswith("RAY_")}
    environment |= {"PYTHONPATH": str(HERE), "RAY_USAGE_STATS_ENABLED": "0"}
    environment |= {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": "a1" * 32}
    with tempfile.TemporaryDirectory(prefix="si-", dir="/tmp", ignore_cleanup_errors=True) as folder:
        head = subprocess.Popen(
            [sys.executable, "-c", _CLUSTER, folder],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        address = head.stdout.readline().strip()
        command = [sys.executable, "-c", _TRAINING, address, str(tmp_path)]
        training = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300, check=False)
        assert training.stdout.strip() == "1", training.stderr
        rest, _ = head.communicate("\n", timeout=60)
        assert rest.strip() == "alive"


@pytest.mark.ray
def test_a_cluster_that_is_not_there_is_one_message(tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    code = (
        "import sys; from pathlib import Path\n"
        "from safe_inspect.errors import ConfigError\n"
        "from safe_inspect.experiments.runs.train import train\n"
        "from safe_inspect.experiments.runs.training_run import TrainingRun\n"
        "try: train(TrainingRun({}, maker='builtins:dict', ray={'address': sys.argv[2]}, output=Path(sys.argv[1])))\n"
        "except ConfigError as error: print(error)"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "out"), address]
    run = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert run.stdout.startswith(f"ray_config.address: no Ray cluster at `{address}` can be joined")
    assert "Connection refused" in run.stdout
    assert not list((tmp_path / "out").iterdir())


def test_auto_is_the_cluster_that_was_started_and_no_private_ray(tmp_path, monkeypatch):
    monkeypatch.setenv("RAY_TMPDIR", str(tmp_path))
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    with pytest.raises(ConfigError, match=r"`auto` can be joined .*`ray start` has started none"):
        next(cluster._attached("auto", {}, 1.0))
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    (tmp_path / "ray").mkdir()
    (tmp_path / "ray" / "ray_current_cluster").write_text(address + "\n")  # as `ray start --head` does
    assert cluster._started_cluster() == address
    with pytest.raises(ConfigError, match=r"`auto` can be joined .*Connection refused"):  # it has died since
        next(cluster._attached("auto", {}, 1.0))
    monkeypatch.setenv("RAY_ADDRESS", "10.0.0.1:6379")
    assert cluster._started_cluster() == "10.0.0.1:6379"


@pytest.mark.ray
@pytest.mark.slow
def test_starting_ray_writes_nothing_into_the_home_folder(tmp_path):
    home, run = tmp_path / "home", tmp_path / "run"
    home.mkdir()
    run.mkdir()
    code = (
        "import sys, os; from pathlib import Path\n"
        "from safe_inspect.experiments.runs.cluster import Claim, ray_cluster, set_environment\n"
        "from safe_inspect.experiments.modules.run_folder import RunFolder\n"
        "from safe_inspect.experiments.settings.translation import translate_ray\n"
        "set_environment()\n"
        "import ray\n"
        "for _ in range(2):\n"
        "    with ray_cluster(translate_ray({}).settings, Claim({'CPU': 1.0}), RunFolder(Path(sys.argv[1]))):\n"
        "        print(ray.get(ray.remote(lambda: 42).remote()))\n"
        "print('RAY_AUTH_TOKEN' in os.environ)"
    )
    environment = {key: value for key, value in os.environ.items() if not key.startswith("RAY_")}
    environment["HOME"] = str(home)
    command = [sys.executable, "-c", code, str(run)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert done.stdout.split() == ["42", "42", "False"], done.stderr
    assert not list(home.iterdir())
    assert not list(run.iterdir())


def test_a_node_that_starts_late_is_waited_for(monkeypatch):
    from ray._private import services

    left = [RuntimeError("not yet"), RuntimeError("not yet"), "node"]

    def get_node(*arguments):
        found = left.pop(0)
        if isinstance(found, Exception):
            raise found
        return found, arguments

    monkeypatch.setattr(services, "get_node", get_node)
    with cluster.patient_start():
        assert services.get_node("address", "id") == ("node", ("address", "id"))
    assert services.get_node is get_node
