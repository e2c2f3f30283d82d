"""Hosts that fall silent without a word: their runs are made elsewhere or fetched later, once."""

from __future__ import annotations

import datetime
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")
pytest.importorskip("distributed")

from fleet_hosts import HANG_S, Client, Fleet, fleet, quick_spec, wait_until
from ros_runs import Bench
from slow_link import SlowLink

pytestmark = pytest.mark.timeout(HANG_S)

SILENT = {"DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "5s"}
"""Dask gives a host up after five minutes."""

_PROGRAM = """
import sys
from r2bspec.fleet.worker import WorkerSettings
WorkerSettings.__init__.__kwdefaults__["heartbeat_s"] = 1.0
from r2bspec.cli.main import main
sys.exit(main())
"""

HASTY = (sys.executable, "-c", _PROGRAM)
"""A worker with ten times as many heartbeats as usual, so that its silence is noticed sooner."""


@pytest.fixture
def hosts(tmp_path: Path) -> Iterator[Fleet]:
    with fleet(tmp_path / "fleet", variables=SILENT) as made:
        yield made


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    return Bench(tmp_path / "bench").write(quick_spec(), "relay")


def wait_until_it_plays(hosts: Fleet, name: str) -> None:
    """Wait for the job in the folder of a host; what the journal calls sent may be on its way."""
    spool = hosts.folder / f"host-{name}" / "spool"
    wait_until(lambda: bool(list(spool.glob("*/job.json"))), f"the run on {name}")


def assert_made_once(done: Client) -> None:
    """One run folder is here, one line of the table, and one event that says it is done."""
    assert len(done.kept()) == len(done.summary()["runs"]) == len(done.events("done")) == 1
    assert done.summary()["runs"][0]["outcome"] != "error"


@only_nightly()
def test_the_run_of_a_frozen_worker_is_made_elsewhere(
    hosts: Fleet, spec: Path, tmp_path: Path
) -> None:
    for name in ("a", "b"):
        hosts.start_worker(name, program=HASTY)
    client = hosts.client(spec, "--hosts", "any", output=tmp_path / "out")
    client.wait_for("sent")
    frozen = client.events("sent")[0].host
    wait_until_it_plays(hosts, frozen)
    hosts.workers[frozen].send_signal(signal.SIGSTOP)
    client.finish()
    assert [event.host for event in client.events("lost")] == [frozen], client.stderr
    (done,) = client.events("done")
    assert done.host != frozen
    assert_made_once(client)
    # The frozen host has played it, too, and says so when it is back: that counts for nothing.
    hosts.workers[frozen].send_signal(signal.SIGCONT)
    wait_until(lambda: hosts.is_back(frozen, 2), "the frozen worker")
    again = hosts.run(spec, "--hosts", "any", "--resume", output=tmp_path / "out")
    assert [event.host for event in again.events("sent")] == [frozen, done.host]
    assert_made_once(again)


@only_nightly()
def test_the_run_of_an_unplugged_host_is_fetched_when_it_is_back(
    hosts: Fleet, spec: Path, tmp_path: Path
) -> None:
    with SlowLink(hosts.port, bytes_per_s=1 << 40) as link:
        hosts.start_worker("far", program=HASTY, at=link.address)
        client = hosts.client(spec, output=tmp_path / "out")
        wait_until_it_plays(hosts, "far")
        link.unplug()
        client.wait_for("lost")
        link.plug_in()
        client.finish()
        (lost,), sent = client.events("lost"), client.events("sent")
        assert {each.identity for each in sent} == {client.events("done")[0].identity}
        assert_made_once(client)
        # It was not played again: it began before its host was given up.
        (run,) = client.kept().values()
        assert parsed(run.record.started_at) < parsed(lost.at)
        hosts.workers["far"].send_signal(signal.SIGTERM)
        hosts.workers["far"].wait()


def parsed(time: str) -> datetime.datetime:
    return datetime.datetime.fromisoformat(time)
