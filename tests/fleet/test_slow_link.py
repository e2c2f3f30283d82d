"""Recordings and results over a slow link that breaks or changes bytes: the rest follows."""

from __future__ import annotations

from pathlib import Path

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")
pytest.importorskip("distributed")

from fleet_hosts import HANG_S, Client, Fleet, fleet, quick_spec
from r2bspec.bags.integrity import hash_files
from r2bspec.fleet.transfer import PIECE_BYTES
from ros_runs import Bench, relay_spec
from slow_link import SlowLink

pytestmark = pytest.mark.timeout(HANG_S)

BYTES_PER_S = 16 << 20
"""A recording takes two seconds: several pieces, of which each takes a quarter of a second."""


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    """A spec whose recording has five to six pieces."""
    topics = {"/camera": range(0, 330, 33), "/other": range(2400)}
    return Bench(tmp_path / "bench", topics)


NOISE = """
import random


class Noise(Node):
    # Answers each image with three megabytes that cannot be compressed.

    def __init__(self, **kwargs):
        super().__init__("node", **kwargs)
        self.noise = random.Random(1).randbytes(1024 * 1024 * 3)
        self.out = self.create_publisher(Image, "output", 10)
        self.create_subscription(Image, "input", self.answer, 10)

    def answer(self, message):
        message.height, message.width, message.step = 1024, 1024, 3 * 1024
        message.data = self.noise
        self.out.publish(message)
"""


def recording_bytes(bench: Bench) -> int:
    return sum(each.stat().st_size for each in bench.bag.iterdir())


def run_over(link: SlowLink, hosts: Fleet, bench: Bench) -> Client:
    """Run a spec on one host that reaches the scheduler over the link."""
    hosts.start_worker("far", at=link.address)
    return hosts.run(bench.write(quick_spec(), "relay"), output=hosts.folder / "out")


def assert_played_with_the_recording(done: Client, hosts: Fleet, bench: Bench) -> None:
    assert list(done.kept()) == ["far/relay"], done.stderr
    (kept,) = (hosts.folder / "host-far" / "work").glob("*/bag")
    assert hash_files(kept) == hash_files(bench.bag)


def test_a_recording_goes_on_where_a_slow_link_broke(bench: Bench, tmp_path: Path) -> None:
    size = recording_bytes(bench)
    assert size > 5 * PIECE_BYTES
    with (
        fleet(tmp_path / "fleet") as hosts,
        SlowLink(hosts.port, bytes_per_s=BYTES_PER_S, cut_at=size * 3 // 4) as link,
    ):
        done = run_over(link, hosts, bench)
    assert link.cuts == 1
    assert_played_with_the_recording(done, hosts, bench)
    # From the beginning it would be three quarters of a recording more; so it is one piece.
    assert size < link.passed < size + 2 * PIECE_BYTES


@only_nightly()
def test_a_recording_that_was_changed_on_its_way_is_sent_again(
    bench: Bench, tmp_path: Path
) -> None:
    size = recording_bytes(bench)
    pixels = bytes([200]) * 1024
    with (
        fleet(tmp_path / "fleet") as hosts,
        SlowLink(hosts.port, bytes_per_s=BYTES_PER_S, spoil=pixels) as link,
    ):
        done = run_over(link, hosts, bench)
    assert link.spoilt == 1
    assert_played_with_the_recording(done, hosts, bench)
    assert 2 * size - PIECE_BYTES < link.passed < 3 * size


@only_nightly()
def test_a_result_goes_on_where_the_slow_link_of_the_client_broke(tmp_path: Path) -> None:
    bench = Bench(tmp_path / "bench")
    bench.write_node("noise.py", NOISE)
    spec = relay_spec(graph={"nodes": {"relay": {"python": "./noise.py:Noise"}}})
    spec["benchmark"] |= {"duration": "400 ms", "warm_up": "0 s"}
    with (
        fleet(tmp_path / "fleet") as hosts,
        SlowLink(hosts.port, bytes_per_s=BYTES_PER_S, cut_at=3 * PIECE_BYTES) as link,
    ):
        hosts.start_worker("near", "--allow-python")
        path = bench.write(spec, "relay")
        done = hosts.client(path, output=tmp_path / "out", at=link.address)
        done.finish()
    assert list(done.kept()) == ["near/relay"], done.stderr
    folder = tmp_path / "out" / "near" / "relay"
    size = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
    assert size > 5 * PIECE_BYTES
    assert link.cuts == 1
    assert len(done.events("lost")) == 1
    # From the beginning it would be three pieces more.
    assert size * 0.9 < link.passed < size + 2 * PIECE_BYTES
    # The host kept it for the client, and played it once.
    assert {event.identity for event in done.events("sent", "done")} == {
        done.events("done")[0].identity
    }
