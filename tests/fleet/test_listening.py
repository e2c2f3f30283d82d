"""Without TLS nothing of a fleet listens beyond this machine: who connects could run programs."""

from __future__ import annotations

import re
import shlex
import signal
import socket
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

pytest.importorskip("distributed")

from fleet_hosts import HANG_S, Fleet, fleet
from r2bspec.cli.main import main
from r2bspec.errors import ExitStatus
from r2bspec.fleet.client import FleetClient
from r2bspec.fleet.security import fleet_address

pytestmark = pytest.mark.timeout(HANG_S)

DOCS = Path(__file__).parents[2] / "docs" / "fleet.md"


def listening(process: psutil.Process) -> set[str]:
    """The addresses at which a process and its children listen."""
    family = [process, *process.children(recursive=True)]
    return {
        connection.laddr.ip
        for member in family
        for connection in member.net_connections("inet")
        if connection.status == psutil.CONN_LISTEN
    }


def test_scheduler_and_worker_listen_on_the_loopback_interface_only(tmp_path: Path) -> None:
    with fleet(tmp_path / "fleet", "a") as hosts:
        assert hosts.scheduler is not None
        worker = psutil.Process(hosts.workers["a"].pid)
        assert listening(worker) == listening(psutil.Process(hosts.scheduler.pid)) == {"127.0.0.1"}
        with FleetClient(fleet_address(hosts.address)) as client:
            assert list(client.hosts) == ["a"]
            assert listening(psutil.Process()) & {"0.0.0.0", "::"} == set()  # noqa: S104
        # A worker has one port: that of Dask's own messages.
        ports = [
            net_connection
            for net_connection in worker.net_connections("inet")
            if net_connection.status == "LISTEN"
        ]
        assert len(ports) == 1


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        *(("--name", name, "--name") for name in ("../x", "a,b", ".x", "a\nb")),
        *(("--listen", place, "error[R2B687") for place in ("0.0.0.0", "::")),  # noqa: S104
        ("--listen", socket.gethostname(), "error[R2B687"),
    ],
)
def test_a_worker_that_no_client_would_take_or_that_others_reach_is_refused(
    option: str, value: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if value == socket.gethostname() and socket.gethostbyname(value).startswith("127."):
        value = "10.0.0.5"
    words = ["fleet", "worker", "tcp://127.0.0.1:9", "--no-doctor"]
    assert main([*words, "--folder", str(tmp_path / "host"), option, value]) == ExitStatus.USAGE
    assert said in capsys.readouterr().err


def test_the_scheduler_of_the_docs_listens_on_the_loopback_interface_only(tmp_path: Path) -> None:
    (line,) = re.findall(
        r"^    dask scheduler --host 127\.0\.0\.1.*$", DOCS.read_text(), re.MULTILINE
    )
    words = shlex.split(line, comments=True)[1:]
    assert words[0] == "scheduler"
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    log = tmp_path / "log"
    with log.open("wb") as output:
        scheduler = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "distributed.cli.dask_scheduler",
                *words[1:],
                "--port",
                str(port),
            ],
            stdout=output,
            stderr=output,
            cwd=tmp_path,
        )
    try:
        process = psutil.Process(scheduler.pid)
        while not listening(process):
            assert scheduler.poll() is None, log.read_text()
        while "Scheduler at" not in log.read_text():
            assert scheduler.poll() is None, log.read_text()
        assert listening(process) == {"127.0.0.1"}
    finally:
        scheduler.send_signal(signal.SIGTERM)
        scheduler.wait(60)


def test_a_worker_that_ends_instead_of_joining_is_named_with_what_it_said(tmp_path: Path) -> None:
    """The tests of fleets tell why a worker never came, and do not wait for it."""
    hosts = Fleet(tmp_path / "fleet")
    program = [sys.executable, "-c", "print('no such thing', flush=True); raise SystemExit(3)"]
    with pytest.raises(AssertionError, match=r"worker a has ended with 3:\nno such thing"):
        hosts.start_worker("a", program=program)
