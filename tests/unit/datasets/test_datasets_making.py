"""Datasets are made once, whole or not at all, always the same, and as the catalogue says."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Sequence
from pathlib import Path

import msgspec
import pytest

from data_bags import WINDOW, refusal_of
from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.bag_reader import read_messages
from r2bspec.bags.integrity import hash_content, verify
from r2bspec.bags.recording import SyntheticDataset, TimeWindow
from r2bspec.datasets.catalogue import DURATION_NS, describe
from r2bspec.datasets.synthesis import GENERATOR_VERSION, make

# Datasets are made once, whole or not at all, and always the same.


IMU = ["/d455_1_imu"]
TOPICS = [*IMU, "/d455_1_left_ir_image"]
SEVENTY_MS = TimeWindow(start_ns=1_000_000_000, end_ns=1_070_000_000)

# Makes a dataset of these topics. With "asking" it says when it begins; with "hold" it stops after
# the first step and says so, until the file "go" appears; with "full" its files may grow to 10 kB.
MAKER = textwrap.dedent(
    """
    import json, pathlib, resource, signal, sys, time
    from r2bspec.bags.recording import DataError
    from r2bspec.bags.recording import TimeWindow
    from r2bspec.datasets.synthesis import GENERATOR_VERSION, make

    # A runner in the background may have switched it off.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    root, mode = pathlib.Path(sys.argv[1]), sys.argv[2]
    if mode == "full":
        resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))

    def hold(done, total):
        if done == 1:
            print("holding", flush=True)
        while not (root / "go").exists():
            time.sleep(0.01)

    if mode == "asking":
        print("asking", flush=True)
    try:
        made = make(
            "r2b_storage",
            sys.argv[3:],
            TimeWindow(start_ns=1_000_000_000, end_ns=1_070_000_000),
            cache_dir=root,
            progress=hold if mode == "hold" else None,
        )
    except DataError as error:
        print(json.dumps({"code": error.code, "message": str(error)}))
    else:
        print(json.dumps({"made": made.made, "sha256": made.content_sha256}))
    """
)


def maker(root: Path, mode: str = "plain", topics: Sequence[str] = IMU) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", MAKER, str(root), mode, *topics]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def outcome(process: subprocess.Popen[str]) -> dict[str, object]:
    with process:
        stdout, _ = process.communicate(timeout=120)
    result: dict[str, object] = json.loads(stdout.splitlines()[-1])
    return result


def holding(process: subprocess.Popen[str]) -> None:
    assert process.stdout is not None
    assert process.stdout.readline() == "holding\n"


def entries(root: Path) -> list[str]:
    """Everything in the cache but its locks."""
    kept = {".locks", "go"}
    return sorted(path.name for path in root.iterdir() if path.name not in kept)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> SyntheticDataset:
    return make("r2b_storage", TOPICS, SEVENTY_MS, cache_dir=tmp_path_factory.mktemp("small"))


@pytest.fixture(scope="module")
def imu(tmp_path_factory: pytest.TempPathFactory) -> SyntheticDataset:
    """What is made at once."""
    return make("r2b_storage", IMU, SEVENTY_MS, cache_dir=tmp_path_factory.mktemp("imu"))


def test_is_made_once(small: SyntheticDataset) -> None:
    again = make("r2b_storage", TOPICS[::-1], SEVENTY_MS, cache_dir=small.path.parent)
    assert small.made
    assert not again.made
    assert (again.path, again.content_sha256) == (small.path, small.content_sha256)
    assert hash_content(small.path) == small.content_sha256


def test_every_machine_renders_the_same_bytes(storage_room: SyntheticDataset) -> None:
    """Specs pin datasets by hash: a change of a rendered byte raises GENERATOR_VERSION."""
    assert GENERATOR_VERSION == 4
    assert verify(storage_room.path) == []
    assert storage_room.content_sha256 == (
        "70697702003e51c5f70130a50a8fe1ff1905085509820e8a2748daaca0617d3e"
    )


def test_mcap_says_the_same(small: SyntheticDataset, tmp_path: Path) -> None:
    mcap = make("r2b_storage", TOPICS, SEVENTY_MS, storage="mcap", cache_dir=tmp_path)
    assert index_bag(mcap.path).storage == "mcap"
    assert mcap.content_sha256 == small.content_sha256
    assert hash_content(mcap.path) == small.content_sha256


def test_two_processes_make_it_once(imu: SyntheticDataset, tmp_path: Path) -> None:
    first = maker(tmp_path, "hold")
    holding(first)
    second = maker(tmp_path, "asking")
    assert second.stdout is not None
    assert second.stdout.readline() == "asking\n"
    # Time to run into the lock; were it not enough, the second would find the dataset made.
    time.sleep(0.5)
    (tmp_path / "go").touch()
    outcomes = [outcome(first), outcome(second)]
    assert [each["made"] for each in outcomes] == [True, False]
    assert {each["sha256"] for each in outcomes} == {imu.content_sha256}


def test_an_interrupted_making_leaves_nothing_behind(imu: SyntheticDataset, tmp_path: Path) -> None:
    process = maker(tmp_path, "hold")
    with process:
        holding(process)
        assert imu.path.name not in entries(tmp_path)
        process.send_signal(signal.SIGINT)
        process.wait(timeout=60)
    assert entries(tmp_path) == []
    assert outcome(maker(tmp_path)) == {"made": True, "sha256": imu.content_sha256}
    assert entries(tmp_path) == [imu.path.name]


def test_a_full_disk_is_reported_and_leaves_nothing(tmp_path: Path) -> None:
    result = outcome(maker(tmp_path, "full"))
    assert result["code"] == "R2B311"
    assert str(tmp_path) in str(result["message"])
    assert entries(tmp_path) == []


@pytest.fixture
def entry(small: SyntheticDataset, tmp_path: Path) -> Path:
    """A dataset that has been made before, in a cache of the test's own."""
    return Path(shutil.copytree(small.path, tmp_path / small.path.name))


def test_a_damaged_entry_is_made_anew(small: SyntheticDataset, entry: Path, tmp_path: Path) -> None:
    (entry / "metadata.yaml").unlink()
    again = make("r2b_storage", TOPICS, SEVENTY_MS, cache_dir=tmp_path)
    assert again.made
    assert again.content_sha256 == small.content_sha256
    assert entries(tmp_path) == [small.path.name]
    assert verify(again.path) == []


# The catalogue describes what will be made, to the byte, without making it.


def test_the_description_is_the_index_of_what_is_made(storage_room: SyntheticDataset) -> None:
    described = describe("r2b_storage", None, WINDOW)
    index = index_bag(storage_room.path)
    assert msgspec.structs.replace(index, files=()) == described


def test_sizes_are_exact(storage_room: SyntheticDataset) -> None:
    topics = describe("r2b_storage", None, WINDOW).topics
    sizes = {name: set[int]() for name in topics}
    for message in read_messages(storage_room.path, topics):
        sizes[message.topic].add(len(message.data))
    assert sizes == {name: {info.max_message_bytes} for name, info in topics.items()}


@pytest.mark.parametrize(
    ("name", "topics", "window", "code", "words"),
    [
        ("r2b_loung", None, None, "R2B307", "did you mean r2b_lounge?"),
        ("kitchen", None, None, "R2B307", "known datasets: r2b_cafe"),
        ("r2b_storage", ["/d455_rgb_image"], None, "R2B308", "did you mean /d455_1_rgb_image?"),
        ("r2b_storage", None, TimeWindow(end_ns=DURATION_NS + 1), "R2B309", "between"),
        ("r2b_storage", None, TimeWindow(start_ns=5, end_ns=5), "R2B309", "between"),
        ("r2b_storage", None, TimeWindow(start_ns=-1), "R2B309", "between"),
    ],
)
def test_refuses_what_it_does_not_carry(
    name: str, topics: list[str] | None, window: TimeWindow | None, code: str, words: str
) -> None:
    error = refusal_of(describe, name, topics, window)
    assert error.code == code
    assert words in error.hint


def test_describing_loads_neither_numpy_nor_rosbags() -> None:
    program = (
        "import sys, r2bspec.datasets.catalogue as data; data.describe('r2b_storage');"
        "sys.exit(bool({'numpy', 'rosbags', 'yaml', 'filelock'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
