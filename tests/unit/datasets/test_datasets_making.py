"""Datasets are made once, whole or not at all, and always the same."""

from __future__ import annotations

import json
import os
import shutil
import signal
import stat
import subprocess
import sys
import textwrap
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from data_bags import refusal_of
from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.bag_reader import read_messages
from r2bspec.bags.integrity import hash_content, verify
from r2bspec.bags.recording import SyntheticDataset, TimeWindow
from r2bspec.datasets import dataset_cache
from r2bspec.datasets.synthesis import GENERATOR_VERSION, make

IMU = ["/d455_1_imu"]
TOPICS = [*IMU, "/d455_1_left_ir_image"]
WINDOW = TimeWindow(start_ns=1_000_000_000, end_ns=1_070_000_000)

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
    return sorted(path.name for path in root.iterdir() if path.name not in {".locks", "go"})


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> SyntheticDataset:
    return make("r2b_storage", TOPICS, WINDOW, cache_dir=tmp_path_factory.mktemp("small"))


@pytest.fixture(scope="module")
def imu(tmp_path_factory: pytest.TempPathFactory) -> SyntheticDataset:
    """What is made at once."""
    return make("r2b_storage", IMU, WINDOW, cache_dir=tmp_path_factory.mktemp("imu"))


def test_is_made_once(small: SyntheticDataset) -> None:
    again = make("r2b_storage", TOPICS[::-1], WINDOW, cache_dir=small.path.parent)
    assert small.made
    assert not again.made
    assert (again.path, again.content_sha256) == (small.path, small.content_sha256)
    assert hash_content(small.path) == small.content_sha256


def test_holds_only_what_was_asked_for(small: SyntheticDataset) -> None:
    index = index_bag(small.path)
    assert sorted(index.topics) == TOPICS
    times_ns = [message.time_ns - index.start_ns for message in read_messages(small.path, TOPICS)]
    assert min(times_ns) >= WINDOW.start_ns
    assert max(times_ns) < (WINDOW.end_ns or 0)


def test_is_the_same_in_another_process_on_one_processor(
    small: SyntheticDataset, tmp_path: Path
) -> None:
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(allowed)})
    try:
        process = maker(tmp_path, topics=TOPICS)
    finally:
        os.sched_setaffinity(0, allowed)
    assert outcome(process) == {"made": True, "sha256": small.content_sha256}


def test_every_machine_renders_the_same_bytes(storage_room: SyntheticDataset) -> None:
    """Specs pin datasets by hash. Whoever changes a rendered byte raises "
    "GENERATOR_VERSION as well."""
    assert GENERATOR_VERSION == 3
    assert verify(storage_room.path) == []
    assert storage_room.content_sha256 == (
        "36eaf8361e586cb7e005cbb2bd4e9d785877dc7f98962647dac70107c4258691"
    )


def test_mcap_says_the_same(small: SyntheticDataset, tmp_path: Path) -> None:
    mcap = make("r2b_storage", TOPICS, WINDOW, storage="mcap", cache_dir=tmp_path)
    assert index_bag(mcap.path).storage == "mcap"
    assert mcap.content_sha256 == small.content_sha256
    assert hash_content(mcap.path) == small.content_sha256


def test_tells_its_progress(tmp_path: Path) -> None:
    steps: list[tuple[int, int]] = []
    make(
        "r2b_storage",
        IMU,
        TimeWindow(end_ns=20_000_000),
        cache_dir=tmp_path,
        progress=lambda done, total: steps.append((done, total)),
    )
    assert steps == [(1, 4), (2, 4), (3, 4), (4, 4)]


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


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_an_interrupted_making_leaves_nothing_behind(
    imu: SyntheticDataset, tmp_path: Path, number: signal.Signals
) -> None:
    process = maker(tmp_path, "hold")
    with process:
        holding(process)
        assert imu.path.name not in entries(tmp_path)
        process.send_signal(number)
        process.wait(timeout=60)
    assert imu.path.name not in entries(tmp_path)
    if number == signal.SIGINT:
        assert entries(tmp_path) == []

    assert outcome(maker(tmp_path)) == {"made": True, "sha256": imu.content_sha256}
    assert entries(tmp_path) == [imu.path.name]


def test_the_remains_of_others_are_removed_unless_they_live(tmp_path: Path) -> None:
    dead = tmp_path / ".making-dead"
    dead.mkdir()
    process = maker(tmp_path, "hold")
    holding(process)
    (live,) = (path for path in tmp_path.glob(".making-*") if path != dead)

    make("r2b_storage", IMU, TimeWindow(end_ns=20_000_000), cache_dir=tmp_path)

    assert not dead.exists()
    assert live.exists()
    (tmp_path / "go").touch()
    assert outcome(process)["made"]


def test_a_full_disk_is_reported_and_leaves_nothing(tmp_path: Path) -> None:
    result = outcome(maker(tmp_path, "full"))
    assert result["code"] == "R2B311"
    assert str(tmp_path) in str(result["message"])
    assert entries(tmp_path) == []


def test_a_cache_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert (
        refusal_of(make, "r2b_storage", IMU, WINDOW, cache_dir=tmp_path / "file" / "cache").code
        == "R2B311"
    )


@pytest.fixture
def entry(small: SyntheticDataset, tmp_path: Path) -> Path:
    """A dataset that has been made before, in a cache of the test's own."""
    return Path(shutil.copytree(small.path, tmp_path / small.path.name))


def test_a_damaged_entry_is_made_anew(small: SyntheticDataset, entry: Path, tmp_path: Path) -> None:
    (entry / "metadata.yaml").unlink()
    again = make("r2b_storage", TOPICS, WINDOW, cache_dir=tmp_path)
    assert again.made
    assert again.content_sha256 == small.content_sha256
    assert entries(tmp_path) == [small.path.name]
    assert verify(again.path) == []


def flip(path: Path, place: float, *, keep_time: bool = False) -> None:
    """Change one bit of a file in place; its size stays."""
    before = path.stat()
    with path.open("r+b") as file:
        file.seek(int(place * before.st_size))
        byte = file.read(1)[0]
        file.seek(-1, os.SEEK_CUR)
        file.write(bytes([byte ^ 1]))
    if keep_time:
        os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


@pytest.mark.parametrize("known", [False, True], ids=["new", "found-intact-before"])
@pytest.mark.parametrize("keep_time", [False, True])
def test_a_message_that_was_changed_in_the_cache_is_never_used(
    small: SyntheticDataset, entry: Path, tmp_path: Path, known: bool, keep_time: bool
) -> None:
    if known:
        assert not make("r2b_storage", TOPICS, WINDOW, cache_dir=tmp_path).made
    (storage,) = entry.glob("*.db3")
    # Most of the file is messages.
    flip(storage, 0.7, keep_time=keep_time)
    again = make("r2b_storage", TOPICS, WINDOW, cache_dir=tmp_path)
    assert again.made
    assert again.damaged
    assert hash_content(again.path) == small.content_sha256 == again.content_sha256


def test_a_record_that_was_changed_with_the_messages_unknown_to_the_cache_is_found(
    small: SyntheticDataset, entry: Path, tmp_path: Path
) -> None:
    text = (entry / "dataset.json").read_text()
    (entry / "dataset.json").write_text(text.replace(small.content_sha256, "0" * 64))
    again = make("r2b_storage", TOPICS, WINDOW, cache_dir=tmp_path)
    assert again.damaged
    assert again.content_sha256 == small.content_sha256


def test_an_unchanged_dataset_is_hashed_once_for_all_processes(
    entry: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hashed: list[Path] = []

    def count(path: Path) -> str:
        hashed.append(path)
        return hash_content(path)

    monkeypatch.setattr(dataset_cache, "hash_content", count)
    for _ in range(3):
        assert not make("r2b_storage", TOPICS, WINDOW, cache_dir=tmp_path).made
    assert hashed == [entry]
    # What was remembered is the user's own, and only that is believed.
    (memory,) = (tmp_path / dataset_cache.CHECKED_FOLDER).iterdir()
    assert stat.S_IMODE(memory.stat().st_mode) == 0o600
    content = memory.read_bytes()
    memory.unlink()
    (tmp_path / "elsewhere").write_bytes(content)
    memory.symlink_to(tmp_path / "elsewhere")
    make("r2b_storage", TOPICS, WINDOW, cache_dir=tmp_path)
    assert len(hashed) == 2


def test_a_made_dataset_is_not_for_other_users(tmp_path: Path) -> None:
    root = tmp_path / "cache" / "datasets"
    made = make("r2b_storage", IMU, TimeWindow(end_ns=20_000_000), cache_dir=root)
    assert stat.S_IMODE(made.path.stat().st_mode) == 0o700
    assert {stat.S_IMODE(each.stat().st_mode) for each in made.path.iterdir()} == {0o600}
    assert stat.S_IMODE(root.stat().st_mode) == 0o700


def test_a_window_may_hold_no_message(tmp_path: Path) -> None:
    window = TimeWindow(start_ns=1, end_ns=2)
    made = make("r2b_storage", IMU, window, cache_dir=tmp_path)
    assert index_bag(made.path).message_count == 0
    assert verify(made.path) == []


def test_no_topics_are_no_dataset(tmp_path: Path) -> None:
    assert refusal_of(make, "r2b_storage", [], WINDOW, cache_dir=tmp_path).code == "R2B308"
