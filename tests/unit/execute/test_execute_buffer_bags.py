"""From the bag that a plan names to buffers of serialised messages."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from r2bspec.bags.integrity import hash_files
from r2bspec.bags.recording import DataError
from r2bspec.execute.errors import CertainRunError
from r2bspec.execute.fill_buffers import buffer_bags, obtain_dataset
from r2bspec.execute.states import Progress
from r2bspec.ipc.buffers import buffered_transforms, read_index, read_messages
from r2bspec.plan.plan import BagTopicPlan, DatasetPlan
from ros_runs import IMAGE, START_NS, STRING, image, text, write_bag
from service_events import ADD_EVENTS, ADD_TYPE, ANSWERED, RECEIVED, SENT, event, write_events
from transform_bags import read_transforms, write_transform_bag

MS = 1_000_000


def topic(name: str, target: str, kind: str = IMAGE) -> BagTopicPlan:
    return BagTopicPlan(bag_topic=name, topic=target, type=kind, count=0, rate_hz=0.0)


def dataset(
    *topics: BagTopicPlan, start_ms: int = 0, end_ms: int | None = None, sha256: str = ""
) -> DatasetPlan:
    return DatasetPlan(
        source="./bag",
        kind="recorded",
        sha256=sha256,
        start_ns=start_ms * MS,
        end_ns=None if end_ms is None else end_ms * MS,
        topics=topics,
    )


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return write_bag(
        tmp_path / "bag",
        {"/left": (0, 33, 66, 99), "/text": (10, 20), "/unused": (0, 33)},
    )


@pytest.fixture
def buffers(tmp_path: Path) -> Path:
    folder = tmp_path / "buffers"
    folder.mkdir()
    return folder


def test_messages_are_buffered_as_they_were_recorded(bag: Path, buffers: Path) -> None:
    plan = dataset(topic("/left", "/r2b/image"), topic("/text", "/r2b/words", STRING))
    assert buffer_bags([bag], [plan], buffers, Progress()) == {"/r2b/image": 4, "/r2b/words": 2}
    index = read_index(buffers, "/r2b/image")
    assert index.has_header
    assert index.stamps_ns == tuple(START_NS + ms * MS for ms in (0, 33, 66, 99))
    messages = read_messages(buffers, "/r2b/image", set(range(4)))
    assert messages == {n: image(n, index.stamps_ns[n]) for n in range(4)}


def test_what_has_no_header_is_stamped_with_its_time_of_recording(bag: Path, buffers: Path) -> None:
    buffer_bags([bag], [dataset(topic("/text", "/words", STRING))], buffers, Progress())
    index = read_index(buffers, "/words")
    assert not index.has_header
    assert index.stamps_ns == (START_NS + 10 * MS, START_NS + 20 * MS)
    assert read_messages(buffers, "/words", {1}) == {1: text("1")}


def test_only_what_the_plan_names_in_the_window_is_buffered(bag: Path, buffers: Path) -> None:
    plan = dataset(topic("left", "/image"), start_ms=20, end_ms=70)
    assert buffer_bags([bag], [plan], buffers, Progress()) == {"/image": 2}
    assert read_index(buffers, "/image").stamps_ns == (START_NS + 33 * MS, START_NS + 66 * MS)
    assert sorted(each.name for each in buffers.iterdir()) == ["image.cdr", "image.json"]


def test_messages_of_one_topic_in_several_bags_are_merged_by_time(
    tmp_path: Path, buffers: Path
) -> None:
    parts = {"first": (0, 40, 80), "second": (20, 60, 100)}
    bags = [write_bag(tmp_path / name, {"/left": times}) for name, times in parts.items()]
    plans = [dataset(topic("/left", "/image")) for _ in bags]
    assert buffer_bags(bags, plans, buffers, Progress()) == {"/image": 6}
    index = read_index(buffers, "/image")
    assert index.times_ns == tuple(START_NS + ms * MS for ms in (0, 20, 40, 60, 80, 100))
    assert index.stamps_ns == index.times_ns


@pytest.mark.parametrize(
    ("times", "expected"),
    [
        ({"first": (0, 40), "second": (60, 100)}, 40),
        ({"first": (70, 90), "second": (60, 100)}, 60),
        ({"first": (0, 90), "second": (45, 100)}, 45),
    ],
    ids=["before the window", "inside", "the last one of all bags"],
)
def test_of_a_latched_topic_the_message_at_the_start_of_the_window_is_buffered(
    tmp_path: Path, buffers: Path, times: dict[str, tuple[int, ...]], expected: int
) -> None:
    bags = [
        write_bag(tmp_path / name, {"/left": each, "/text": (0, 110)})
        for name, each in times.items()
    ]
    plans = [dataset(topic("/left", "/map"), start_ms=50) for _ in bags]
    assert buffer_bags(bags, plans, buffers, Progress(), ["/map"]) == {"/map": 1}
    assert read_index(buffers, "/map").times_ns == (START_NS + expected * MS,)


def test_of_the_events_of_a_service_the_requests_of_one_side_are_buffered(
    tmp_path: Path, buffers: Path
) -> None:
    events = [
        (0, event(SENT, request=b"sent 1")),
        (1, event(RECEIVED, request=b"received 1")),
        (2, event(ANSWERED, request=b"a response")),
        # Of another client, which does not publish what it sends.
        (11, event(RECEIVED, request=b"received 2", big_endian=True)),
        (21, event(RECEIVED)),
    ]
    bag = write_events(tmp_path / "calls", events)
    plan = dataset(topic(ADD_EVENTS, "/calls", ADD_TYPE))
    assert buffer_bags([bag], [plan], buffers, Progress()) == {"/calls": 2}
    index = read_index(buffers, "/calls")
    assert index.times_ns == (START_NS + 1 * MS, START_NS + 11 * MS)
    assert [data[48:] for data in read_messages(buffers, "/calls").values()] == [
        b"received 1",
        b"received 2",
    ]
    early = dataset(topic(ADD_EVENTS, "/calls", ADD_TYPE), end_ms=1)
    buffer_bags([bag], [early], buffers, Progress())
    assert read_index(buffers, "/calls").times_ns == (START_NS,)
    none = dataset(topic(ADD_EVENTS, "/calls", ADD_TYPE), start_ms=20)
    with pytest.raises(DataError, match="and no request") as refused:
        buffer_bags([bag], [none], buffers, Progress())
    assert refused.value.code == "R2B242"


def test_transforms_are_buffered_where_they_are_asked_for(tmp_path: Path, buffers: Path) -> None:
    bag = write_transform_bag(
        tmp_path / "moving", (0, 100), (5, 50, 95), (("base", "camera"), ("arm", "camera"))
    )
    asked = dataset(topic("/camera", "/image"), start_ms=40)
    plan = msgspec.structs.replace(asked, publish_tf=True, publish_tf_static=True)
    counts = buffer_bags([bag], [plan], buffers, Progress())
    assert counts == {"/image": 1, "/tf": 2, "/tf_static": 1}
    assert buffered_transforms(buffers) == ("/tf", "/tf_static")
    (static,) = read_messages(buffers, "/tf_static", {0}).values()
    # Static transforms come from the whole bag: they were published once, at its beginning.
    assert read_transforms(bytes(static)) == [("arm", "camera", START_NS)]


@pytest.mark.parametrize("pinned", [None, "", "sha256:"])
def test_a_bag_is_found_beside_the_spec_and_hashed(
    tmp_path: Path, bag: Path, pinned: str | None
) -> None:
    digest = hash_files(bag)
    sha256 = "" if pinned is None else pinned + digest.removeprefix("sha256:")
    found = obtain_dataset(dataset(topic("/left", "/image"), sha256=sha256), tmp_path, Progress())
    assert found.path == bag
    assert found.provenance == {
        "source": "./bag",
        "kind": "recorded",
        "path": str(bag),
        "sha256": digest,
    }


def test_another_bag_than_the_one_that_was_pinned_or_none_is_refused(
    tmp_path: Path, bag: Path
) -> None:
    with pytest.raises(CertainRunError, match="the hash of ./bag is") as raised:
        obtain_dataset(dataset(topic("/left", "/image"), sha256="0" * 64), tmp_path, Progress())
    assert hash_files(bag) in str(raised.value)
    assert raised.value.exit_code == 2
    with pytest.raises(DataError, match="bag does not exist"):
        obtain_dataset(dataset(topic("/left", "/image")), tmp_path / "other", Progress())
