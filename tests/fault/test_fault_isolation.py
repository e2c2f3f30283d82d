"""Promise: what runs is what was planned, with nothing of the user's that it does not need."""

from __future__ import annotations

import contextlib
import json
import os
import stat
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from r2bspec.execute.processes.environment import inherited_environment
from r2bspec.execute.processes.process import SLICE_NS, slice_of
from r2bspec.middleware.middleware import SHARED_MEMORY
from r2bspec.native.build import harness_program
from ros_runs import Bench, Finished, Running, relay_node, relay_spec

SECRETS = {
    "MY_TOKEN": "7c5e2b9d-not-for-anyone",
    "AWS_SECRET_ACCESS_KEY": "f3b1-not-for-anyone-either",
    "http_proxy": "http://user:e41a-nor-this@proxy",
}
NAMED = {"NAMED_TOKEN": "90cc1d-for-nodes-only"}

OWN = {
    "R2BSPEC_RUN_ID",
    "R2BSPEC_MODULES_FOLDER",
    "R2BSPEC_CONTROL_FD",
    "ROS_DOMAIN_ID",
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS_LOG_DIR",
    "PYTHONPATH",
    "PYTHONUNBUFFERED",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_DEFAULT_PROFILES_FILE",
}
"""What docs/reliability.md says that every process of a run gets."""

MEMORY = {"MALLOC_MMAP_MAX_", "MALLOC_TRIM_THRESHOLD_", "MALLOC_TOP_PAD_", "GLIBC_TUNABLES"}
"""What those of the harness get, too."""

SHOWS = "import os, time; print(sorted(os.environ)); time.sleep(600)"


@dataclass(frozen=True)
class Seen:
    """A process as the kernel shows it."""

    argv: list[str]
    environ: dict[str, str]
    session: int
    group: int
    pid: int
    folder: Path
    slices: set[int]


@dataclass(frozen=True)
class Looked:
    """A run that has ended, with what its processes were, and the plan as printed before it.

    Attributes:
        made: the files that it has left.
        shared: the modes of its shared memory and of its scratch folder, while it ran.
    """

    done: Finished
    seen: dict[str, Seen]
    plan: dict[str, Any]
    made: set[Path]
    shared: dict[Path, int]


def look(process: psutil.Process) -> Seen:
    return Seen(
        argv=process.cmdline(),
        environ=process.environ(),
        session=os.getsid(process.pid),
        group=os.getpgid(process.pid),
        pid=process.pid,
        folder=Path(process.cwd()),
        # Threads of the middleware, too, which inherit it.
        slices={slice_of(thread.id) for thread in process.threads()},
    )


def shared_by(bench: Bench, running: Running) -> dict[Path, int]:
    """The modes of the shared memory that the processes of a run map, and of its scratch folder."""
    mapped = set()
    for process in bench.processes():
        with contextlib.suppress(psutil.Error):
            if process.environ().get("R2BSPEC_RUN_ID") is not None:
                mapped |= {Path(memory_map.path) for memory_map in process.memory_maps()}
    # Ports below those of domain 0 are shared by all runs, and may be another program's.
    segments = [
        each
        for each in mapped
        if each.parent == SHARED_MEMORY
        and each.name.startswith(("fast", "sem.fast"))
        and "_port7" not in each.name
    ]
    (scratch,) = running.folder.glob(".scratch-*")
    return {
        each: stat.S_IMODE(each.stat().st_mode) for each in (*segments, scratch) if each.exists()
    }


@pytest.fixture(scope="module")
def looked(tmp_path_factory: pytest.TempPathFactory) -> Looked:
    bench = Bench(tmp_path_factory.mktemp("isolation"))
    home = bench.folder / "home"
    home.mkdir()
    spec = relay_spec(
        environment=list(NAMED),
        setup={"note": {"command": ["touch", "made"], "creates": "made"}},
        graph={
            "nodes": {
                "relay": relay_node(env={"MY_SETTING": "on"}),
                "shows": {"command": [sys.executable, "-c", SHOWS, "$HOME", "; touch oops"]},
            }
        },
    )
    # On a busy machine, to look at the processes takes as long as two iterations.
    spec["benchmark"] |= {"iterations": 6}
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (SECRETS | NAMED | {"HOME": str(home)}).items():
            patch.setenv(name, value)
        path = bench.write(spec, "isolated")
        printed = subprocess.run(
            [sys.executable, "-m", "r2bspec", "plan", str(path)],
            capture_output=True,
            text=True,
            check=True,
        )
        before, mask = set(bench.folder.rglob("*")), os.umask(0o022)
        try:
            with bench.start(path) as running:
                running.wait_for("iteration 1 of 6")
                names = ("player", "monitor", "relay", "shows")
                seen = {name: look(running.child(name)) for name in names}
                shared = shared_by(bench, running)
                done = running.finish()
        finally:
            os.umask(mask)
    made = {file for file in bench.folder.rglob("*") if file not in before}
    return Looked(done, seen, json.loads(printed.stdout), made, shared)


def test_the_record_says_which_middleware_the_processes_loaded(looked: Looked) -> None:
    # Where none is selected, ROS 2 loads this one.
    assert looked.done.result()["versions"]["rmw"] == "rmw_fastrtps_cpp"
    assert "rmw_fastrtps_cpp" in looked.done.stdout


def processes(looked: Looked) -> dict[str, dict[str, Any]]:
    """The planned processes of the measurement, by name."""
    planned = {each["name"]: each for each in looked.plan["processes"]}
    return {name: each for name, each in planned.items() if each["phase"] == "measure"}


def test_the_run_went_to_its_end(looked: Looked) -> None:
    looked.done.assert_complete()
    # The plan that was carried out is, byte for byte, the one that was printed.
    assert json.loads((looked.done.folder / "plan.json").read_text()) == looked.plan


def test_every_process_runs_the_command_line_that_the_plan_prints(looked: Looked) -> None:
    planned = processes(looked)
    assert set(planned) == set(looked.seen)
    # Kept below the home of the run, which is another one here.
    kept = Path(*harness_program().parts[-3:])
    home = looked.seen["player"].environ["HOME"]
    programs = {"$(python)": sys.executable, "$(harness)": f"{home}/.cache/r2bspec/{kept}"}
    for name, seen in looked.seen.items():
        words = [programs.get(word, word) for word in planned[name]["argv"]]
        assert seen.argv == words, name


def test_no_word_of_a_command_goes_through_a_shell(looked: Looked) -> None:
    assert looked.seen["shows"].argv[-2:] == ["$HOME", "; touch oops"]
    assert not [each for each in looked.made if each.name == "oops"]


def test_every_process_has_a_session_and_a_group_of_its_own(looked: Looked) -> None:
    for name, seen in looked.seen.items():
        assert seen.session == seen.group == seen.pid, name


def test_every_process_has_the_environment_that_the_plan_states_and_no_more(
    looked: Looked,
) -> None:
    planned = processes(looked)
    kept = inherited_environment(dict.fromkeys(os.environ | SECRETS | NAMED, ""), NAMED)
    for name, seen in looked.seen.items():
        changes = planned[name].get("env", {})
        harness = MEMORY if planned[name]["role"] in {"player", "monitor"} else set()
        assert set(seen.environ) - set(kept) - set(changes) <= OWN | harness, name
        assert changes.items() <= seen.environ.items()
        for secret, value in NAMED.items():
            assert seen.environ[secret] == value
    assert processes(looked)["relay"]["env"] == {"MY_SETTING": "on"}
    assert "MY_SETTING" not in looked.seen["shows"].environ


def test_secrets_reach_neither_processes_nor_the_run_folder(looked: Looked) -> None:
    for name, seen in looked.seen.items():
        for secret, value in SECRETS.items():
            assert secret not in seen.environ, name
            assert value not in seen.environ.values()
    texts = [looked.done.stdout, looked.done.stderr, json.dumps(looked.plan)]
    texts += [
        path.read_bytes().decode("latin-1")
        for path in looked.done.folder.rglob("*")
        if path.is_file()
    ]
    for value in (*SECRETS.values(), *NAMED.values()):
        assert not [text for text in texts if value in text]
    # Their names are, where a node prints them: it saw those that the spec names.
    assert "NAMED_TOKEN" in looked.done.log("shows")
    assert not [name for name in SECRETS if name in looked.done.log("shows")]


def test_a_run_writes_nothing_outside_its_folder(looked: Looked) -> None:
    folder = looked.done.folder
    outside = {
        each
        for each in looked.made
        if not each.is_relative_to(folder)
        # Where this test keeps what the command prints; Python's and the kernel's own caches; the
        # lock of the setup step.
        and not each.name.startswith((".stdout", ".stderr", ".made.lock"))
        and "__pycache__" not in each.parts
        and ".cache" not in each.parts
    }
    # What a setup step makes is the user's, and has the modes that the user wants.
    made = folder.parent / "made"
    assert outside == {made}
    assert stat.S_IMODE(made.stat().st_mode) == 0o644


@pytest.mark.skipif(slice_of(0) == 0, reason="this kernel has no time slices for each process")
def test_only_player_and_monitor_have_a_shorter_time_slice(looked: Looked) -> None:
    slices = {name: looked.seen[name].slices for name in ("player", "monitor", "relay")}
    assert slices == {"player": {SLICE_NS}, "monitor": {SLICE_NS}, "relay": {slice_of(0)}}


def test_no_other_user_may_read_what_a_run_writes_or_sends(looked: Looked) -> None:
    assert len(looked.shared) > 1
    assert {str(each): oct(mode) for each, mode in looked.shared.items() if mode & 0o077} == {}
    written = (looked.done.folder, *looked.done.folder.rglob("*"))
    assert [each for each in written if stat.S_IMODE(each.stat().st_mode) & 0o077] == []


@only_nightly()
def test_what_a_dying_node_prints_of_its_secrets_does_not_reach_the_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in NAMED.items():
        monkeypatch.setenv(name, value)
    program = "import os; raise SystemExit('refused: ' + os.environ['NAMED_TOKEN'])"
    spec = relay_spec(environment=list(NAMED))
    spec["graph"]["nodes"]["dies"] = {"command": [sys.executable, "-c", program]}
    done = Bench(tmp_path).run(spec)
    assert done.status == 4
    assert "refused: ***" in done.error
    (value,) = NAMED.values()
    for text in (done.stdout, done.stderr, (done.folder / "record.json").read_text()):
        assert value not in text
