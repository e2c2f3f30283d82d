"""What processes record of themselves is read as it happened; damage is said, or left out."""

from __future__ import annotations

import contextlib
import os
import socket
import threading
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from native_playlists import SANITIZERS
from r2bspec.native.build import BuildError, anatomy_object, join_environment, join_object
from r2bspec.record.anatomy_files import AnatomyReader, file_bytes
from r2bspec.record.files import RecordError
from r2bspec.record.run_record import AnatomyKind
from r2bspec.record.sample_arrays import ANATOMY_DTYPE
from stubbed_ros import Linked, call_ros

OBJECTS = [
    ("publisher", "/resolved/out", "/space/node"),
    ("publisher", "/resolved/bare", "/space/node"),
    ("publisher", "/resolved/empty", "/space/node"),
    ("publisher", "/resolved/several", "/space/node"),
    ("subscription", "/resolved/in", "/space/node"),
    ("client", "/resolved/ask", "/space/node"),
    ("service", "/resolved/answer", "/space/node"),
    ("timer", "", "/space/node"),
    ("buffer", "/resolved/in", "/space/node"),
]
S = 10**9
EVENTS = [
    ("PUBLISH", "out", 0, 1, 0, 1 * S + 2),
    ("PUBLISH", "bare", 0, 2, 0, 0),
    ("PUBLISH", "empty", 0, 3, 0, 0),
    ("PUBLISH", "several", 0, 4, 0, 0),
    ("PUBLISH", "out", 0, 5, 0, 1 * S + 2),
    ("PUBLISH", "out", 0, 6, 0, 5 * S + 6),
    ("PUBLISH", "out", 0, 7, 0, 0),
    ("WAIT", "", 0, 0, 0, 0),
    ("TAKE", "in", 1, 0, 0, 0),
    ("TAKE", "in", 0, 1000, 2000, 3 * S + 4),
    ("CALLBACK", "in", 0, 0, 0, 0),
    ("TIMER", "timer", 0, 0, 0, 0),
    ("CALLBACK", "timer", 0, 0, 0, 0),
    ("TAKE", "in", 0, 1000, 2000, 5 * S + 6),
    ("TAKE", "in", 0, 1000, 2000, 7 * S + 8),
    ("TRIGGER", "", 0, 0, 0, 0),
    ("SEND_REQUEST", "ask", 0, 42, 0, 0),
    ("TAKE_REQUEST", "answer", 1, 0, 0, 0),
    ("TAKE_REQUEST", "answer", 0, 42, 2, 0),
    ("SEND_RESPONSE", "answer", 0, 42, 0, 0),
    ("TAKE_RESPONSE", "ask", 0, 42, 2, 0),
    ("PUBLISH", "out", 2, 0, 0, 1 * S + 2),
    ("ENQUEUE", "buffer", 2, 3, 0, 0),
    ("DEQUEUE", "buffer", 2, 3, 0, 0),
    ("CALLBACK", "buffer", 0, 0, 0, 0),
    ("PUBLISH", "", 0, 8, 0, 0),
]
"""Kind, object, flags, source, reception and header of what ``call_ros.c`` calls, in its order."""


def events(folder: Path) -> list[tuple[str, str, int, int, int, int]]:
    """As `EVENTS`."""
    rows, objects, _ = AnatomyReader(folder).read()
    names = ["", *(each.name if each.kind != "buffer" else "buffer" for each in objects)]
    names = [name.rpartition("/")[2] for name in names]
    names = [name or ("timer" if index else "") for index, name in enumerate(names)]
    values = rows[["kind", "object", "flags", "source_ns", "received_ns", "header_ns"]].tolist()
    return [(AnatomyKind(kind).name, names[index], *others) for kind, index, *others in values]


@pytest.mark.parametrize("how", ["linked", "loaded"])
def test_each_call_is_an_event_and_reaches_what_it_is_meant_for(
    tmp_path: Path, how: Linked
) -> None:
    """Whether the process is linked to rcl, or loads it for itself alone, as rclpy does."""
    done = call_ros(tmp_path, "each", how=how)
    assert (done.returncode, done.stderr) == (0, "")
    rows, objects, (process,) = AnatomyReader(tmp_path).read()
    assert [(each.kind, each.name, each.node) for each in objects] == OBJECTS
    assert events(tmp_path) == EVENTS
    assert process.name == "name/of process"
    assert process.lost == 0
    (file,) = tmp_path.iterdir()
    assert file.name == f"name%of process.{process.pid}.rows"
    # It has ended: the room that it did not need belongs to others.
    assert file.stat().st_size < file_bytes(0)
    # Two of the tracepoints are called on only while a tracer is there.
    traced = int(done.stdout.split()[0])
    (tmp_path / "traced").mkdir()
    done = call_ros(tmp_path / "traced", "each", how=how, environment={"STUB_TRACED": "1"})
    assert int(done.stdout.split()[0]) == traced + 2
    assert (np.diff(rows["began_ns"]) >= 0).all()
    assert (rows["ended_ns"] >= rows["began_ns"]).all()
    nested = rows[rows["kind"] == AnatomyKind.CALLBACK]
    assert nested["ended_ns"][1] <= nested["ended_ns"][0]
    assert set(rows["thread"]) == {process.pid}


@pytest.mark.parametrize("how", ["linked", "loaded"])
@pytest.mark.parametrize("first", ["anatomy", "join"])
def test_the_object_that_brings_the_harness_works_before_and_behind_it(
    tmp_path: Path, how: Linked, first: str
) -> None:
    path, rows = tmp_path / "socket", tmp_path / "rows"
    rows.mkdir()
    asked: list[bytes] = []

    def answer() -> None:
        with contextlib.closing(server.accept()[0]) as connection:
            asked.append(connection.recv(100))

    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))
        server.listen()
        controller = threading.Thread(target=answer)
        controller.start()
        environment = join_environment(join_object(), path, "node", "")
        if first == "anatomy":
            preloaded = environment.pop("LD_PRELOAD")
        else:
            preloaded = ""
            environment["LD_PRELOAD"] += f":{anatomy_object()}"
        done = call_ros(rows, "each", how=how, preloaded=preloaded, environment=environment)
        controller.join(60)
    assert (done.returncode, done.stderr) == (0, "")
    assert asked == [b"process node\n"]
    assert events(rows) == EVENTS


def test_threads_share_a_file_without_losing_or_mixing_anything(tmp_path: Path) -> None:
    call_ros(tmp_path, "threads", "8", "1000")
    rows, _, (process,) = AnatomyReader(tmp_path).read()
    assert process.lost == 0
    assert sorted(rows["source_ns"]) == [*range(1, 8001)]
    assert sorted(Counter(rows["thread"].tolist()).values()) == [1000] * 8
    for thread in set(rows["thread"]):
        own = rows[rows["thread"] == thread]
        assert (np.diff(own["source_ns"]) > 0).all()
        assert (own["began_ns"][1:] >= own["ended_ns"][:-1]).all()
    # What the clocks show differs by less than an adjustment of the system's would be.
    assert np.ptp(rows["clock_ns"]) < 1e9


def test_what_has_no_room_is_counted(tmp_path: Path) -> None:
    call_ros(tmp_path, "threads", "4", "5000", max_bytes=file_bytes(1000))
    rows, _, (process,) = AnatomyReader(tmp_path).read()
    assert len(rows) >= 1000
    assert len(rows) + process.lost == 20_000


@pytest.mark.parametrize("how", ["linked", "loaded"])
def test_a_forked_child_writes_nothing(tmp_path: Path, how: Linked) -> None:
    assert call_ros(tmp_path, "fork", how=how).returncode == 0
    rows, objects, _ = AnatomyReader(tmp_path).read()
    assert rows["source_ns"].tolist() == [1, 2, 3]
    assert len(objects) == 1


def test_what_a_killed_process_has_finished_is_read(tmp_path: Path) -> None:
    assert call_ros(tmp_path, "killed", "700").returncode < 0
    assert len(AnatomyReader(tmp_path).read()[0]) == 700


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"max_bytes": 1_000_000}, "No space left on device"),
        ({"max_bytes": 1 << 62}, "File too large|No space left on device|Invalid argument"),
        ({"environment": {"R2BSPEC_ANATOMY_FOLDER": "/nowhere"}}, "No such file or directory"),
        ({"environment": {"R2BSPEC_ANATOMY_FOLDER": "/" + "x" * 5000}}, "File name too long"),
    ],
)
def test_a_process_without_a_file_says_why_and_goes_on(
    tmp_path: Path, change: dict[str, Any], reason: str
) -> None:
    done = call_ros(tmp_path, "each", **change)
    assert done.returncode == 0
    assert done.stdout.endswith(" traced\n")
    (line,) = done.stderr.splitlines()
    assert line.startswith("r2bspec cannot observe this process: ")
    assert any(line.endswith(each) for each in reason.split("|"))
    assert AnatomyReader(tmp_path).read()[1:] == ((), ())


@pytest.mark.parametrize(
    "words", [["each"], ["threads", "8", "500"], ["brief", "300"], ["fork"], ["objects", "3"]]
)
def test_sanitizers_find_nothing(tmp_path: Path, words: list[str]) -> None:
    options = {"ASAN_OPTIONS": "detect_leaks=0:verify_asan_link_order=0"}
    try:
        done = call_ros(tmp_path, *words, flags=SANITIZERS, environment=options)
    except BuildError as error:
        pytest.skip(f"the compiler has no sanitizers here: {error}")
    assert (done.returncode, done.stderr) == (0, "")
    assert len(AnatomyReader(tmp_path).read()[0]) > 0


def rows_file(folder: Path, *words: str, max_bytes: int = file_bytes(256)) -> Path:
    call_ros(folder, *(words or ("each",)), max_bytes=max_bytes)
    (path,) = folder.glob("*.rows")
    return path


def test_events_that_are_not_finished_or_cannot_be_are_left_out(tmp_path: Path) -> None:
    path = rows_file(tmp_path, "threads", "1", "100")
    content = bytearray(path.read_bytes())
    start = content.index(AnatomyReader(tmp_path).read()[0][0].tobytes())
    rows = np.frombuffer(content, ANATOMY_DTYPE, count=100, offset=start)
    rows["kind"][0] = 0
    rows["kind"][1] = 99
    rows["began_ns"][2] = rows["ended_ns"][2] + 1
    rows["header_ns"][3] = 1 << 62 | 1
    rows["object"][4] = 77
    rows["process"][5] = 12
    path.write_bytes(content)
    kept, _, (process,) = AnatomyReader(tmp_path).read()
    assert len(kept) == 96
    assert process.lost == 3
    assert kept["object"].tolist() == [0] + [1] * 95
    assert set(kept["process"]) == {0}


def test_files_of_others_are_passed_over(tmp_path: Path) -> None:
    rows_file(tmp_path)
    (tmp_path / "notes.txt").write_text("what somebody has left")
    # Its process was killed while it made the file.
    (tmp_path / "empty.1.rows").write_bytes(b"")
    (tmp_path / "zeros.1.rows").write_bytes(bytes(1 << 20))
    assert len(AnatomyReader(tmp_path).read()[2]) == 1


def test_a_damaged_file_and_a_folder_that_is_not_there_are_named(tmp_path: Path) -> None:
    def assert_refused(place: Path) -> None:
        with pytest.raises(RecordError, match=str(place)) as caught:
            AnatomyReader(folder).read()
        assert caught.value.hint

    folder = tmp_path / "rows"
    assert_refused(folder)
    folder.mkdir()
    path = rows_file(folder)
    os.truncate(path, 5000)
    assert_refused(path)
    path.write_bytes(b"\x93NUMPY" * 300_000)
    assert_refused(path)
    elsewhere = path.rename(tmp_path / "elsewhere")

    def link() -> None:
        path.symlink_to(elsewhere)

    def pipe() -> None:
        os.mkfifo(path)

    for replace in (link, pipe, path.mkdir):
        path.unlink(missing_ok=True)
        replace()
        assert_refused(path)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return rows_file(tmp_path_factory.mktemp("written")).read_bytes()


HEADER_BYTES = 336
CHANGES = st.lists(
    st.tuples(
        st.one_of(st.integers(0, HEADER_BYTES), st.integers(0, 1 << 21)),
        st.binary(min_size=1, max_size=16),
    ),
    max_size=8,
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(changes=CHANGES, size=st.none() | st.integers(0, 1 << 21))
def test_no_file_breaks_the_reader(
    tmp_path: Path, written: bytes, changes: list[tuple[int, bytes]], size: int | None
) -> None:
    content = bytearray(written)
    for place, data in changes:
        content[place : place + len(data)] = data
    (tmp_path / "fuzzed.1.rows").write_bytes(content[:size])
    found, said = None, "is damaged"
    try:
        found = AnatomyReader(tmp_path).read()
    except RecordError as error:
        said = str(error)
    assert "is damaged" in said
    rows, objects, processes = found or (np.empty(0, ANATOMY_DTYPE), (), ())
    assert rows.dtype == ANATOMY_DTYPE
    assert (rows["object"] <= len(objects)).all()
    assert (rows["process"] < max(1, len(processes))).all()
    assert all(AnatomyKind(kind) for kind in rows["kind"].tolist())
    assert all(0 <= each.lost < 1 << 63 for each in processes)
