"""What travels over Dask itself: a host's answers are data, and what Dask unpickles is known."""

from __future__ import annotations

import asyncio
import os
import sys
from pathlib import Path
from typing import Any

import psutil
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("distributed")

from fleet_hosts import HANG_S, fleet, quick_spec
from ros_runs import Bench

pytestmark = pytest.mark.timeout(HANG_S)

LIAR = """
import sys
from pathlib import Path
from distributed.protocol.serialize import Serialized, pickle_dumps
import distributed.worker
import r2bspec.fleet.host_service as service


class Evil:
    def __reduce__(self):
        return (exec, ("import os; open({place!r}, 'a').write(str(os.getpid()))",))


if {how!r} == "object":
    service.HostService.answer = lambda *_: Evil()
else:
    # As a worker would that takes no notice of what its client understands.
    distributed.worker.to_serialize = lambda value: Serialized(*pickle_dumps(Evil()))
from r2bspec.cli.main import main
sys.exit(main())
"""


@pytest.mark.parametrize("how", ["object", "pickle"])
def test_a_client_does_not_unpickle_what_a_host_answers(how: str, tmp_path: Path) -> None:
    place = tmp_path / "executed"
    program = [sys.executable, "-c", LIAR.format(place=str(place), how=how)]
    with fleet(tmp_path / "fleet", "b") as hosts:
        hosts.start_worker("a", program=program)
        spec = Bench(tmp_path / "bench").write(quick_spec(), "relay")
        done = hosts.run(spec, "--hosts", "a", output=tmp_path / "out1")
        assert done.status == 2, done.stderr
        assert "R2B686" in done.stderr
        assert "the host a does not do what it is asked" in done.stderr
        assert "Traceback" not in done.stderr
        assert done.kept() == {}
        done = hosts.run(spec, "--hosts", "any", output=tmp_path / "out2")
        assert [run["host"] for run in done.summary()["runs"]] == ["b"], done.stderr
    assert not place.exists()


class Executed:
    """Writes the number of the process that unpickles it."""

    def __init__(self, place: Path) -> None:
        self.place = str(place)

    def __reduce__(self) -> Any:
        return (os.system, (f"echo $PPID > {self.place}",))


async def send(address: str, message: dict[str, Any]) -> None:
    from distributed.comm.core import connect

    comm = await connect(address)  # type: ignore[no-untyped-call]
    try:
        await comm.write(message)
        await asyncio.wait_for(comm.read(), 30)
    except (TimeoutError, OSError, TypeError, ValueError):
        pass
    finally:
        comm.abort()


def test_who_reaches_scheduler_or_worker_runs_code_as_the_documentation_says(
    tmp_path: Path,
) -> None:
    """If this fails, Dask has become safer, and docs/fleet.md and `fleet.security` say too much."""
    from distributed.protocol.serialize import ToPickle

    with fleet(tmp_path / "fleet", "a") as hosts:
        assert hosts.scheduler is not None
        worker = psutil.Process(hosts.workers["a"].pid)
        (port,) = (
            net_connection.laddr.port
            for net_connection in worker.net_connections("inet")
            if net_connection.status == "LISTEN"
        )
        for pid, address in (
            (hosts.scheduler.pid, hosts.address),
            (worker.pid, f"tcp://127.0.0.1:{port}"),
        ):
            place = tmp_path / str(pid)
            asyncio.run(send(address, {"op": "identity", "x": ToPickle(Executed(place))}))
            assert int(place.read_text()) == pid
