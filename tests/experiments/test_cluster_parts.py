"""How Ray is started for a run and what is left behind, with a Ray that only notes what it is asked for."""

from __future__ import annotations

import os
import secrets
import signal
import socket
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

from safe_inspect.compiling import COMPILING_NOTE
from safe_inspect.errors import ConfigError
from safe_inspect.experiments.modules.run_folder import RunFolder
from safe_inspect.experiments.runs import cluster
from safe_inspect.experiments.runs.cluster import Claim
from safe_inspect.experiments.settings.translation import translate_ray

pytestmark = pytest.mark.ray


class FakeRay:
    """Notes how it is started; `running` is whether this process has a Ray already."""

    def __init__(self) -> None:
        self.running, self.calls = False, list[Any]()
        self.resources = {"CPU": 4.0}
        self.inside: dict[str, Any] = {}

    def init(self, **options: Any) -> None:
        self.calls.append(options)
        if options["address"] == "local":
            self.resources = {"CPU": options["num_cpus"]}
        self.inside = {name: os.environ.get(name) for name in ("PYTHONPATH", COMPILING_NOTE, "RAY_AUTH_TOKEN")}
        folder = Path(options["_temp_dir"]) if "_temp_dir" in options else None
        if folder is not None:
            self.inside["temporary"] = folder.is_dir()
            logs = folder / "session_1" / "logs"
            logs.mkdir(parents=True)
            (folder / "session_latest").symlink_to(logs.parent)
            for name, text in (
                ("raylet.out", "shown"),
                ("worker-1.err", "worse"),
                ("other.log", "x"),
                ("raylet.err", ""),
            ):
                (logs / name).write_text(text)

    def shutdown(self) -> None:
        self.calls.append("shutdown")


def cpus(number: float) -> Claim:
    return Claim({"CPU": number, "GPU": 0.0})


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> FakeRay:
    """Return the Ray that `cluster` finds."""
    import ray

    made = FakeRay()
    monkeypatch.setattr(ray, "init", made.init)
    monkeypatch.setattr(ray, "shutdown", made.shutdown)
    monkeypatch.setattr(ray, "is_initialized", lambda: made.running)
    monkeypatch.setattr(ray, "cluster_resources", lambda: made.resources)
    monkeypatch.setattr(os, "cpu_count", lambda: 3)
    for name in ("RAY_AUTH_TOKEN", "RAY_AUTH_MODE", "RAY_ADDRESS"):
        monkeypatch.delenv(name, raising=False)
    return made


def run_of(tmp_path: Path) -> RunFolder:
    (tmp_path / "run").mkdir()
    return RunFolder(tmp_path / "run")


def test_a_local_ray_gets_its_settings_and_leaves_nothing(fake: FakeRay, tmp_path: Path) -> None:
    folder = run_of(tmp_path)
    old = Path(tempfile.mkdtemp(prefix="si-", dir="/tmp"))
    (old / "session_latest").symlink_to("session_1")
    folder.ray_note.write_text(str(old))  # of an attempt that was killed
    settings = translate_ray({"namespace": "mine", "num_gpus": 0, "resources": {"a": 1}, "logging_level": "warning"})
    path_before = os.environ.get("PYTHONPATH")
    with cluster.ray_cluster(settings.settings, cpus(2.5), folder):
        assert not old.exists()
        noted = Path(folder.ray_note.read_text())
        assert noted.is_dir()
        assert len(fake.calls) == 1
    options, stop = fake.calls
    assert stop == "shutdown"
    assert options == {
        "address": "local", "num_cpus": 3, "object_store_memory": 256 * 2**20, "_temp_dir": str(noted), "num_gpus": 0,
        "resources": {"a": 1}, "include_dashboard": False, "log_to_driver": False, "namespace": "mine",
        "logging_level": "WARNING",
    }  # fmt: skip
    assert fake.inside["temporary"]
    assert fake.inside["PYTHONPATH"] == os.pathsep.join(path for path in sys.path if path)
    assert fake.inside[COMPILING_NOTE] == str(folder.compiling_note)
    assert os.environ.get("PYTHONPATH") == path_before
    assert COMPILING_NOTE not in os.environ
    assert not noted.exists()
    assert not folder.ray_note.exists()
    assert not list(folder.path.iterdir())


@pytest.mark.parametrize(
    ("given", "claimed", "started"), [({}, 2.0, 3), ({}, 4.5, 5), ({"num_cpus": 8}, 2.0, 8), ({"num_cpus": 2}, 2.0, 2)]
)
def test_a_local_ray_has_the_processors_that_the_run_claims(
    fake: FakeRay, given: dict[str, Any], claimed: float, started: int
) -> None:
    with cluster.ray_cluster(translate_ray(given).settings, cpus(claimed), None):
        assert fake.calls[0]["num_cpus"] == started


def test_what_does_not_fit_starts_nothing(fake: FakeRay, tmp_path: Path) -> None:
    given = translate_ray({"num_cpus": 2, "temporary_folder": str(tmp_path)}).settings
    with (
        pytest.raises(ConfigError, match="needs 3 processors, but Ray has 2"),
        cluster.ray_cluster(given, cpus(3.0), None),
    ):
        pass
    fake.running = True
    with (
        pytest.raises(ConfigError, match="needs 5 processors, but Ray has 4"),
        cluster.ray_cluster({}, cpus(5.0), None),
    ):
        pass
    assert not fake.calls


@pytest.mark.parametrize(
    ("given", "resources", "message", "starts"),
    [
        ({}, {"GPU": 1.0}, "num_gpus: the training needs 1 GPU, but Ray has 0; lower `num_gpus_per_learner`", True),
        ({"num_gpus": 1}, {"GPU": 1.5}, "num_gpus: the training needs 1.5 GPUs, but Ray has 1; lower", False),
        ({}, {"a": 2.0}, "resources: the training needs 2 `a`, but Ray has 0; lower it in rllib_configs", True),
        ({"resources": {"a": 1}}, {"a": 2.0}, "resources: the training needs 2 `a`, but Ray has 1", False),
    ],
)  # fmt: skip
def test_a_resource_that_ray_does_not_have_is_refused(
    fake: FakeRay, given: dict[str, Any], resources: dict[str, float], message: str, starts: bool
) -> None:
    settings, claim = translate_ray(given).settings, Claim({"CPU": 1.0, **resources})
    with pytest.raises(ConfigError, match=message), cluster.ray_cluster(settings, claim, None):
        pass
    assert fake.calls[1:] == ["shutdown"] * starts
    fake.running, fake.resources = True, {"CPU": 1.0, **resources}
    with cluster.ray_cluster(settings, claim, None):
        pass


@pytest.mark.parametrize(("given", "claimed", "warned"), [({}, 3.0, 0), ({}, 4.0, 1), ({"num_cpus": 9}, 4.0, 1)])
def test_a_machine_with_fewer_processors_than_processes_is_named_before_ray_starts(
    fake: FakeRay, recwarn: pytest.WarningsRecorder, given: dict[str, Any], claimed: float, warned: int
) -> None:
    with cluster.ray_cluster(translate_ray(given).settings, Claim({"CPU": claimed}, 4), None):
        pass
    texts = [str(warning.message) for warning in recwarn]
    assert texts == warned * [
        "the training claims 4 processors, but this machine has 3; its processes share them (4, of about 0.5 GB each); "
        "if it is too slow, lower `num_env_runners` in rllib_configs"
    ]


def test_a_ray_of_the_process_is_used_and_left_running(fake: FakeRay) -> None:
    fake.running = True
    with cluster.ray_cluster(translate_ray({}).settings, cpus(4.0), None):
        pass
    assert not fake.calls


@pytest.mark.parametrize(("full", "kept"), [(False, {"raylet.out": "shown", "worker-1.err": "worse"}), (True, {})])
def test_the_logs_of_a_run_that_fails_are_kept(
    fake: FakeRay, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, full: bool, kept: dict[str, str]
) -> None:
    folder = run_of(tmp_path)
    monkeypatch.setattr(cluster, "is_full", lambda path: full)
    with pytest.raises(RuntimeError, match="lost"), cluster.ray_cluster(translate_ray({}).settings, cpus(1.0), folder):
        raise RuntimeError("lost")
    assert {path.name: path.read_text() for path in folder.path.glob("ray_logs/*")} == kept
    assert fake.calls[-1] == "shutdown"
    assert not folder.ray_note.exists()


def test_a_cluster_is_joined_and_left(fake: FakeRay) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"127.0.0.1:{server.getsockname()[1]}"
        settings = translate_ray({"address": address, "runtime_env": {"a": "b"}}).settings
        with cluster.ray_cluster(settings, cpus(4.0), None):
            joined = {"address": address, "log_to_driver": False, "runtime_env": {"a": "b"}, "logging_level": "ERROR"}
            assert fake.calls == [joined]
        assert fake.calls == [joined, "shutdown"]
        with pytest.raises(ConfigError, match=r"needs 4\.1 processors"), cluster.ray_cluster(settings, cpus(4.1), None):
            pass
        assert fake.calls == [joined, "shutdown", joined, "shutdown"]


def test_why_a_cluster_cannot_be_joined_is_in_its_last_line(fake: FakeRay, monkeypatch: pytest.MonkeyPatch) -> None:
    import ray

    def refuse(**_: Any) -> None:
        raise RuntimeError("a story") from ValueError("first\nthe reason \n\n")

    monkeypatch.setattr(ray, "init", refuse)
    with (
        pytest.raises(ConfigError) as caught,
        cluster.ray_cluster({"address": "head", "logging_level": "x"}, cpus(1), None),
    ):
        pass
    (problem,) = caught.value.problems
    assert (problem.path, problem.message) == (
        "ray_config.address", "no Ray cluster at `head` can be joined (the reason)",
    )  # fmt: skip
    assert problem.hint.startswith("start one with `ray start --head`, set RAY_AUTH_MODE=token if")


@pytest.mark.parametrize(
    ("name", "knocks"), [("", False), ("head", False), ("ray://127.0.0.1:{}", True), ("127.0.0.1:{}", True)]
)
def test_it_is_looked_whether_anyone_listens(name: str, knocks: bool) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = name.format(free.getsockname()[1])
    if knocks:
        with pytest.raises(ConnectionRefusedError):
            cluster._knock(address)
    else:
        cluster._knock(address)


def test_rays_processes_inherit_one_token_and_keep_that_of_the_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "_token", "")
    monkeypatch.setattr(sys, "path", ["", "/a", "/b"])
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("RAY_AUTH_MODE", "token")
    assert cluster._for_processes(None) == {"PYTHONPATH": f"/a{os.pathsep}/b"}
    monkeypatch.delenv("RAY_AUTH_MODE")
    (tmp_path / ".ray").mkdir()
    (tmp_path / ".ray" / "auth_token").write_text("x")
    assert "RAY_AUTH_TOKEN" not in cluster._for_processes(None)
    (tmp_path / ".ray" / "auth_token").unlink()
    token = cluster._for_processes(RunFolder(tmp_path))["RAY_AUTH_TOKEN"]
    assert len(token) == 64
    monkeypatch.setenv("RAY_AUTH_MODE", "token")
    assert cluster._for_processes(None)["RAY_AUTH_TOKEN"] == token


def test_variables_are_set_for_as_long_as_the_context_lasts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SI_KNOWN", "before")
    monkeypatch.delenv("SI_NEW", raising=False)
    with cluster._inherited({"SI_KNOWN": "now", "SI_NEW": "here"}):
        assert (os.environ["SI_KNOWN"], os.environ["SI_NEW"]) == ("now", "here")
    assert os.environ["SI_KNOWN"] == "before"
    assert "SI_NEW" not in os.environ


def test_the_variables_of_ray_do_not_replace_those_of_the_user(monkeypatch: pytest.MonkeyPatch) -> None:
    variables = {"RAY_worker_niceness": "7"}
    monkeypatch.setattr(os, "environ", variables)
    cluster.set_environment()
    assert variables == {**cluster._ENVIRONMENT, "RAY_worker_niceness": "7"}


@pytest.mark.skipif(os.name != "posix", reason="signals are blocked there alone")
def test_what_ray_starts_outlives_the_signals_of_its_group() -> None:
    def blocked() -> set[int]:
        return set(signal.pthread_sigmask(signal.SIG_BLOCK, []))

    before = blocked()
    with cluster._outliving_signals():
        assert blocked() - before == {signal.SIGTERM, signal.SIGHUP} - before
    assert blocked() == before
    with pytest.raises(cluster.Interrupted) as stopped, cluster._outliving_signals():
        raise SystemExit
    assert stopped.value.number == signal.SIGTERM
    assert blocked() == before


@pytest.mark.parametrize(("length", "fits"), [(8, True), (23, True), (24, False)])
def test_the_longest_folder_that_rays_sockets_fit_in(length: int, fits: bool) -> None:
    base = Path("/tmp") / secrets.token_hex(12)[:length]
    try:
        if fits:
            folder = cluster._temporary_folder(str(base))
            assert folder.parent == base
            assert folder.name.startswith("si-")
            folder.rmdir()
        else:
            with pytest.raises(ConfigError, match=r"too long for Ray's sockets \(28 characters at most\)"):
                cluster._temporary_folder(str(base))
    finally:
        base.rmdir()
