"""Runs on a real scheduler and three real workers, which share the lock of this machine."""

from __future__ import annotations

import json
import random
import shutil
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")
pytest.importorskip("distributed")

from fleet_hosts import HANG_S, RUNS, Fleet, fleet, overlapping, quick_spec, wait_until
from r2bspec._version import __version__
from r2bspec.record.run_folder import open_run
from ros_runs import Bench

pytestmark = pytest.mark.timeout(HANG_S)

HOSTS = ("a", "b", "c")


@pytest.fixture(scope="module")
def hosts(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    """Three hosts, which tests may kill and start again."""
    with fleet(tmp_path_factory.mktemp("fleet") / "fleet", *HOSTS) as made:
        yield made


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path / "bench")


def rows(summary: Any) -> list[tuple[Any, ...]]:
    """What of a table does not differ between two runs of a spec."""
    return [
        (run["name"], row["offered_hz"], row["pace"], row["monitor"], run["outcome"] != "error")
        for run in summary["runs"]
        for row in run["rows"]
    ]


def test_every_host_plays_the_spec_and_the_table_is_that_of_a_local_run(
    hosts: Fleet, bench: Bench, tmp_path: Path
) -> None:
    spec = bench.write(quick_spec(), "relay")
    done = hosts.run(spec, "--report", f"junit={tmp_path}/r.xml", output=tmp_path / "out")
    here = bench.run(spec, "--each")
    summary = json.loads((here.folder / "suite.json").read_text())
    assert rows(done.summary()) == [row for row in rows(summary) for _ in HOSTS]
    assert [run["host"] for run in done.summary()["runs"]] == list(HOSTS)
    found = done.kept()
    assert list(found) == [f"{name}/relay" for name in HOSTS]
    assert overlapping(list(done.runs().values())) == []
    assert len({run.record.run_id for run in found.values()}) == len(HOSTS)
    played_here = open_run(here.folder / "relay").record.plan_hash
    assert {run.record.plan_hash for run in found.values()} == {played_here}
    assert not (tmp_path / "out" / ".incoming").exists()
    assert hosts.spools() == []
    text = (tmp_path / "r.xml").read_text()
    assert all(f"relay on {name}" in text for name in HOSTS)
    sent = done.events("sent")
    again = hosts.run(spec, "--resume", output=tmp_path / "out")
    assert all(run["resumed"] for run in again.summary()["runs"])
    assert again.events("sent") == sent
    assert {each.host for each in sent} == set(HOSTS)


def test_no_run_is_lost_or_counted_twice_while_workers_are_killed(
    hosts: Fleet, bench: Bench, tmp_path: Path
) -> None:
    spec = bench.write(quick_spec(), "relay")
    titles = ",".join(f"run{number}" for number in range(RUNS))
    client = hosts.client(
        spec, "--scan", f"title={titles}", "--hosts", "any", output=tmp_path / "out"
    )
    seed = random.Random(7)  # noqa: S311 - any sequence will do
    kills = 0
    while client.process.poll() is None and kills < max(2, RUNS // 6):
        sent = client.next_events("sent")
        if not sent:
            break
        victim = seed.choice([sent[-1].host, *HOSTS])
        hosts.kill_worker(victim)
        hosts.start_worker(victim)
        kills += 1
    client.finish()
    assert client.status in (0, 1, 3, 4), client.stderr
    summary = client.summary()
    names = [run["name"] for run in summary["runs"]]
    assert names == [f"relay[title=run{number}]" for number in range(RUNS)]
    assert [run["outcome"] for run in summary["runs"] if not run["rows"]] == []
    done = Counter(event.run for event in client.events("done"))
    assert set(done.values()) == {1}
    assert len(done) == RUNS
    found = client.runs()
    assert set(client.kept()) == set(done)
    assert len({run.record.run_id for run in found.values()}) == len(found)
    assert overlapping(list(found.values())) == []
    assert kills >= 1
    assert client.events("lost")
    assert "Traceback" not in client.stderr
    assert "never retrieved" not in client.stderr


@only_nightly()
def test_a_client_that_was_killed_is_resumed(hosts: Fleet, bench: Bench, tmp_path: Path) -> None:
    spec = bench.write(quick_spec(), "relay")
    words = (spec, "--scan", "title=run1,run2,run3", "--hosts", "any")
    first = hosts.client(*words, output=tmp_path / "out")
    first.wait_for("done")
    first.kill()
    before = {path: run.record.run_id for path, run in first.runs().items()}
    assert len(before) > 0
    again = hosts.run(*words, "--resume", output=tmp_path / "out")
    found = again.runs()
    assert {path: run.record.run_id for path, run in found.items() if path in before} == before
    assert len(again.kept()) == len(again.summary()["runs"]) == 3
    done = Counter(event.run for event in again.events("done"))
    assert all(count == 1 for path, count in done.items() if path in before)
    assert [run["outcome"] for run in again.summary()["runs"] if not run["rows"]] == []


@only_nightly()
def test_the_scheduler_may_be_restarted(hosts: Fleet, bench: Bench, tmp_path: Path) -> None:
    spec = bench.write(quick_spec(), "relay")
    client = hosts.client(
        spec, "--scan", "title=run1,run2", "--hosts", "any", output=tmp_path / "out"
    )
    client.wait_for("sent")
    hosts.kill_scheduler()
    hosts.start_scheduler()
    client.finish()
    assert len(client.runs()) >= 2, client.stderr
    assert [run["outcome"] for run in client.summary()["runs"] if not run["rows"]] == []
    assert Counter(event.run for event in client.events("done")).most_common(1)[0][1] == 1
    assert overlapping(list(client.runs().values())) == []


@only_nightly()
def test_two_clients_share_the_hosts(hosts: Fleet, bench: Bench, tmp_path: Path) -> None:
    spec = bench.write(quick_spec(), "relay")
    clients = [
        hosts.client(spec, "--hosts", "a", output=tmp_path / f"out{number}") for number in (1, 2)
    ]
    found = [run for client in clients for run in client.finish().runs().values()]
    assert len({run.record.run_id for run in found}) == len(found) >= 2
    assert overlapping(found) == []
    refused = hosts.client(spec, output=tmp_path / "out3")
    wait_until((tmp_path / "out3" / "fleet.jsonl").exists, "the journal")
    second = hosts.run(spec, output=tmp_path / "out3")
    assert second.status == 2
    assert "another client runs the suite" in second.stderr
    refused.kill()


def test_a_spec_chooses_its_host_and_one_that_no_host_fits_is_said_at_once(
    hosts: Fleet, bench: Bench, tmp_path: Path
) -> None:
    bench.write(quick_spec("here", requires={"labels": {"robot": "b"}}), "here")
    bench.write(quick_spec("nowhere", requires={"cores": 9999}), "nowhere")
    done = hosts.run(bench.folder, output=tmp_path / "out")
    runs = {run["name"]: run for run in done.summary()["runs"]}
    assert runs["here"]["host"] == "b"
    assert list(done.kept()) == ["b/here"]
    assert runs["nowhere"]["outcome"] == "error"
    assert "R2B683" in runs["nowhere"]["reason"]
    assert all(f"{name}: it has" in runs["nowhere"]["reason"] for name in HOSTS)
    assert done.status == 2
    assert done.stderr.index("error[R2B683") < done.stderr.index("[1/1] here")


def test_a_pair_stays_on_its_host(hosts: Fleet, bench: Bench, tmp_path: Path) -> None:
    spec = bench.write(quick_spec(), "relay")
    base = "set:graph.nodes.relay.parameters.service_time_ms=2.0"
    done = hosts.run(
        spec, "--against", base, "--pairs", "1", "--hosts", "c", output=tmp_path / "out"
    )
    (run,) = done.summary()["runs"]
    assert (run["host"], run["outcome"] != "error") == ("c", True), done.stderr
    folders = sorted((tmp_path / "out" / "c" / "relay").glob("*/0*/record.json"))
    assert {folder.parent.parent.name for folder in folders} == {"base", "head"}


def test_files_of_a_spec_need_the_permission_of_the_host(
    hosts: Fleet, bench: Bench, tmp_path: Path
) -> None:
    bench.write_node("helper.py", "LATER = True\n")
    bench.write_node(
        "own.py",
        "from helper import LATER\nfrom r2bspec.nodes import RelayNode\n\n\n"
        "class Own(RelayNode):\n    pass\n",
    )
    bench.write_node("other.py", "")
    spec = quick_spec()
    spec["graph"]["nodes"]["relay"] = {
        **spec["graph"]["nodes"]["relay"],
        "python": "./own.py:Own",
        "subscribes": {"input": "sensor_msgs/msg/Image"},
        "publishes": {"output": "sensor_msgs/msg/Image"},
    }
    path = bench.write(spec, "own")
    refused = hosts.run(path, "--hosts", "a", output=tmp_path / "out1")
    assert refused.status == 2
    assert "R2B685" in refused.stderr
    assert "--allow-python" in refused.stderr
    hosts.kill_worker("a")
    hosts.start_worker("a", "--label", "robot=a", "--allow-python")
    done = hosts.run(path, "--hosts", "a", output=tmp_path / "out2")
    assert list(done.kept()) == ["a/relay"], done.stderr
    sent = {file.name for file in hosts.folder.glob("host-a/work/*/*")}
    assert {"own.py", "helper.py"} <= sent
    assert "other.py" not in sent


def test_a_host_of_another_version_is_refused_with_both(
    hosts: Fleet, bench: Bench, tmp_path: Path
) -> None:
    older = (
        "import sys; import r2bspec._version as v; v.__version__ = '0.0.1'; "
        "from r2bspec.cli.main import main; sys.exit(main())"
    )
    hosts.start_worker("old", "--label", "robot=old", program=[sys.executable, "-c", older])
    try:
        done = hosts.run(
            bench.write(quick_spec(), "relay"), "--hosts", "old", output=tmp_path / "out"
        )
    finally:
        hosts.workers["old"].send_signal(signal.SIGTERM)
        hosts.workers["old"].wait()
    (run,) = done.summary()["runs"]
    assert (done.status, run["outcome"]) == (2, "error")
    assert "R2B684" in run["reason"]
    assert "0.0.1" in run["reason"]
    assert __version__ in run["reason"]
    assert done.events("sent") == []


def test_a_host_without_room_leaves_the_run_to_others(
    hosts: Fleet, bench: Bench, tmp_path: Path
) -> None:
    folder = hosts.folder / "host-full"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=100k,mode=700", "tmpfs", str(folder)]
    try:
        subprocess.run(command, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("this user cannot mount a small disk")
    try:
        hosts.start_worker("full", "--label", "robot=full")
        spec = bench.write(quick_spec(), "relay")
        alone = hosts.run(spec, "--hosts", "full", output=tmp_path / "out1")
        (run,) = alone.summary()["runs"]
        assert run["outcome"] == "error"
        assert "R2B689" in run["reason"]
        assert alone.status == 4
        done = hosts.run(spec, "--hosts", "any", output=tmp_path / "out2")
        (run,) = done.summary()["runs"]
        assert run["host"] in HOSTS
    finally:
        hosts.workers["full"].kill()
        hosts.workers["full"].wait()
        subprocess.run(["umount", "-l", str(folder)], check=True)  # noqa: S607


def test_nothing_but_caches_is_left_on_hosts(hosts: Fleet) -> None:
    wait_until(lambda: not list(hosts.folder.glob("host-[abc]/spool/*/run")), "the last run")
    for name in HOSTS:
        left = {each.name for each in (hosts.folder / f"host-{name}").iterdir()}
        assert left <= {"objects", "work", "spool", "dask", ".lock"}
    shutil.rmtree(hosts.folder / "tmp", ignore_errors=True)
