"""What a fleet plays again, and what it keeps: invalid runs, and caches up to their limit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")
pytest.importorskip("distributed")

from fleet_hosts import HANG_S, Fleet, fleet
from ros_runs import Bench, relay_node, relay_spec

pytestmark = pytest.mark.timeout(HANG_S)

NODES = """
from pathlib import Path


class Doubles(Node):
    # Answers every message twice, which by order is impossible; with `once` in its first run only.

    def __init__(self, **kwargs):
        super().__init__("node", **kwargs)
        self.declare_parameter("once", True)
        before = Path(__file__).with_name("played")
        is_sound = self.get_parameter("once").value and before.exists()
        before.touch()
        self.times = 1 if is_sound else 2
        self.out = self.create_publisher(Image, "output", 100)
        self.create_subscription(Image, "input", self.answer, 100)

    def answer(self, message):
        for _ in range(self.times):
            self.out.publish(message)
"""


def doubling(bench: Bench, *, once: bool) -> Path:
    """A spec whose run is invalid on a host, always or the first time."""
    bench.write_node("doubles.py", NODES)
    node = {"python": "./doubles.py:Doubles", "parameters": {"once": once}}
    spec = relay_spec(graph={"nodes": {"node": node}})
    spec["monitors"]["out"]["match"] = "order"
    spec["slos"] = {"received": {"at": "20 Hz", "require": ["received > 0"]}}
    return bench.write(spec, "doubling")


@only_nightly()
def test_an_invalid_run_is_made_again_on_its_host_and_no_oftener(tmp_path: Path) -> None:
    bench = Bench(tmp_path / "bench")
    with fleet(tmp_path / "fleet") as hosts:
        for name in ("a", "b"):
            hosts.start_worker(name, "--allow-python")
        words = (doubling(bench, once=True), "--hosts", "any", "--retry-invalid", "3")
        done = hosts.run(*words, output=tmp_path / "once")
        (kept,) = done.kept()
        # A busy machine may make it invalid once more.
        assert [event.state for event in done.events("invalid", "done")][:1] == ["invalid"]
        assert {event.host for event in done.events("sent")} == {done.events("done")[0].host}
        assert (
            len({event.identity for event in done.events("sent")}) == len(done.events("sent")) > 1
        )
        (run,) = done.summary()["runs"]
        assert run["outcome"] != "invalid"
        assert f"{kept}.invalid-1" in done.runs()
        always = hosts.run(doubling(bench, once=False), "--hosts", "b", output=tmp_path / "always")
        assert [event.state for event in always.events("invalid", "done")] == ["invalid", "done"]
        (run,) = always.summary()["runs"]
        assert (run["outcome"], always.status) == ("invalid", 4)


def cached_bytes(hosts: Fleet) -> int:
    """What the folder of the host takes of its disk; hard links count once."""
    files = [
        file.stat()
        for kind in ("objects", "work", "spool")
        for file in (hosts.folder / "host-small" / kind).rglob("*")
        if file.is_file() and not file.is_symlink()
    ]
    return sum({status.st_ino: status.st_size for status in files}.values())


@only_nightly()
def test_a_host_keeps_no_more_than_its_limit_and_is_sent_again_what_it_removed(
    tmp_path: Path,
) -> None:
    bench = Bench(tmp_path / "bench", {"/camera": range(0, 3300, 33)})
    recording_bytes = sum(each.stat().st_size for each in bench.bag.iterdir())
    limit_bytes = round(recording_bytes * 1.5)
    other = Bench(tmp_path / "other", {"/camera": range(0, 3300, 33), "/text": range(10)})
    spec: dict[str, Any] = relay_spec(graph={"nodes": {"relay": relay_node()}})
    spec["benchmark"] |= {"duration": "200 ms", "warm_up": "0 s"}
    first, second = bench.write(spec, "relay"), other.write(spec, "relay")
    with fleet(tmp_path / "fleet") as hosts:
        hosts.start_worker("small", "--cache-limit", f"{limit_bytes} B")
        kept = hosts.folder / "host-small" / "objects"
        seen = []
        for number, each in enumerate((first, second, first)):
            done = hosts.run(each, "--smoke", output=tmp_path / f"out{number}")
            assert list(done.kept()) == ["small/relay"], done.stderr
            assert cached_bytes(hosts) <= limit_bytes
            sizes = {file.name: file.stat().st_size for file in kept.iterdir()}
            seen.append({name for name, size in sizes.items() if size > recording_bytes / 2})
        # There is room for one of the two.
        assert [len(each) for each in seen] == [1, 1, 1]
        assert seen[0] == seen[2] != seen[1]
