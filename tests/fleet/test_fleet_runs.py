"""Runs on a real scheduler and three real workers on the loopback interface."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from nightly import only_nightly, size

pytest.importorskip("rclpy")
pytest.importorskip("distributed")

from fleet_hosts import HANG_S, Hosts, fleet, quick_spec, wait_until
from r2bspec.record.run_folder import open_run
from ros_runs import Bench

pytestmark = pytest.mark.timeout(HANG_S)

HOSTS = ("a", "b", "c")[: size(2, 3)]
RUNS = size(3, 6)
PLAYED = (0, 4)
"""The exit status of runs that pass, or are invalid as the machine was late."""


@pytest.fixture(scope="module")
def hosts(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hosts]:
    with fleet(tmp_path_factory.mktemp("fleet") / "fleet", *HOSTS) as made:
        yield made


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path / "bench")


def shape(folder: Path) -> Any:
    """What does not differ between two complete runs of a spec: plan, files, keys of the result."""
    record = open_run(folder).record
    assert record.status == "complete"
    files = {file.name for file in folder.iterdir()} - {"fleet.log"}
    result = json.loads((folder / "result.json").read_text())
    return record.plan_hash, files, sorted(result), result["spec"]


def test_runs_end_well_though_a_host_is_lost_in_the_middle(
    hosts: Hosts, bench: Bench, tmp_path: Path
) -> None:
    spec = bench.write(quick_spec(), "relay")
    output = tmp_path / "out"
    titles = ",".join(f"run{number}" for number in range(RUNS))
    client = hosts.start_client(spec, "--scan", f"title={titles}", output=output)
    wait_until(lambda: len(list(output.glob("*/result.json"))) >= 2, "two runs")
    wait_until(lambda: bool(hosts.playing()), "a run that plays")
    victim = hosts.playing()[0]
    hosts.kill_worker(victim)
    done = hosts.finish(client, output)
    assert done.status in PLAYED, done.stderr
    runs = done.runs().values()
    assert [run["name"] for run in runs] == [f"relay[title=run{number}]" for number in range(RUNS)]
    assert {run["outcome"] for run in runs} <= {"pass", "invalid"}
    assert len({open_run(Path(run["folder"])).record.run_id for run in runs}) == RUNS
    assert f"the host {victim} has left the fleet" in done.stderr
    assert "Traceback" not in done.stderr
    here = bench.run(spec, "--scan", "title=run0")
    folder = Path(next(iter(runs))["folder"])
    assert shape(folder) == shape(here.folder / folder.name)
    again = hosts.run(spec, "--scan", f"title={titles}", "--resume", output=output)
    assert all(run["resumed"] for run in again.runs().values())
    hosts.start_worker(victim)


@only_nightly()
def test_a_run_whose_only_host_is_lost_is_played_when_it_is_back(
    hosts: Hosts, bench: Bench, tmp_path: Path
) -> None:
    spec = bench.write(quick_spec(requires={"labels": {"robot": "b"}}), "relay")
    client = hosts.start_client(spec, output=tmp_path / "out")
    wait_until(lambda: "b" in hosts.playing(), "the run")
    hosts.kill_worker("b")
    hosts.start_worker("b")
    done = hosts.finish(client, tmp_path / "out")
    assert done.runs()["relay on b"]["outcome"] != "error", done.stderr


def test_a_spec_chooses_its_host_and_what_no_host_fits_is_said_before_anything_runs(
    hosts: Hosts, bench: Bench, tmp_path: Path
) -> None:
    bench.write(quick_spec("here", requires={"labels": {"robot": "b"}}), "here")
    bench.write(quick_spec("nowhere", requires={"cores": 9999}), "nowhere")
    done = hosts.run(bench.folder, "--hosts", "all", output=tmp_path / "out")
    runs = done.runs()
    assert runs["here on b"]["outcome"] != "error", done.stderr
    assert runs["nowhere on "]["outcome"] == "error"
    assert all(f"{name}: it has" in runs["nowhere on "]["reason"] for name in HOSTS)
    assert done.status == 2
    assert done.stderr.index("error[R2B683") < done.stderr.index("[1/1] here on b")


@only_nightly()
def test_pairs_are_played_on_one_host(hosts: Hosts, bench: Bench, tmp_path: Path) -> None:
    spec = bench.write(quick_spec(), "relay")
    base = "set:graph.nodes.relay.parameters.service_time_ms=2.0"
    words = ("--against", base, "--pairs", "1", "--hosts", "c")
    done = hosts.run(spec, *words, output=tmp_path / "out")
    assert done.runs()["relay on c"]["outcome"] != "error", done.stderr
    folders = (tmp_path / "out" / "c" / "relay").glob("*/0*/record.json")
    assert {folder.parent.parent.name for folder in folders} == {"base", "head"}


def test_python_files_travel_and_a_run_that_fails_is_told_with_its_log(
    hosts: Hosts, bench: Bench, tmp_path: Path
) -> None:
    bench.write_node("helper.py", "LATER = True\n")
    bench.write_node(
        "own.py",
        "from helper import LATER\nfrom r2bspec.nodes import RelayNode\n\n\n"
        "class Own(RelayNode):\n    pass\n",
    )
    bench.write_node(
        "broken.py",
        "from r2bspec.nodes import RelayNode\n\n\nclass Own(RelayNode):\n"
        "    def __init__(self, **options):\n        raise RuntimeError('no camera')\n",
    )
    for name in ("own", "broken"):
        spec = quick_spec(name)
        spec["graph"]["nodes"]["relay"] = {
            **spec["graph"]["nodes"]["relay"],
            "python": f"./{name}.py:Own",
            "subscribes": {"input": "sensor_msgs/msg/Image"},
            "publishes": {"output": "sensor_msgs/msg/Image"},
        }
        bench.write(spec, name)
    done = hosts.run(bench.folder, output=tmp_path / "out")
    outcomes = {name.split()[0]: run["outcome"] for name, run in done.runs().items()}
    assert outcomes["own"] != outcomes["broken"] == "error", done.stderr
    assert done.status in {2, 4}
    assert "error[R2B6" in done.stderr
    assert "no camera" in (tmp_path / "out" / "broken" / "fleet.log").read_text()
    assert "broken/fleet.log" in done.stderr


def test_a_client_without_scheduler_ends_with_an_error(bench: Bench) -> None:
    spec = bench.write(quick_spec(), "relay")
    with bench.start(spec, "--on", "tcp://127.0.0.1:1", verb="fleet run") as running:
        done = running.finish()
    assert done.status == 4
    assert "R2B682" in done.stderr
    assert "dask scheduler" in done.stderr
