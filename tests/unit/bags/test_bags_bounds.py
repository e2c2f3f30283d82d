"""Promise: a few bytes of metadata or of a type do not cost long work."""

from __future__ import annotations

from pathlib import Path

import pytest

from r2bspec.bags.metadata import read_metadata
from r2bspec.bags.recording import DataError
from r2bspec.bags.storage import ros1
from r2bspec.safe_io import limits

HEAD = """\
rosbag2_bagfile_information:
  version: 5
  storage_identifier: sqlite3
  starting_time: {nanoseconds_since_epoch: 0}
  duration: {nanoseconds: 1}
  message_count: 0
"""


def topics(number: int, name: str = "/t") -> str:
    return "  topics_with_message_count:\n" + "".join(
        f"  - {{message_count: 0, topic_metadata: {{name: {name}{index}, type: a/msg/B, "
        "serialization_format: cdr}}\n"
        for index in range(number)
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            f"  relative_file_paths: [{'a.db3, ' * 20_000}]\n{topics(1)}",
            "the file a.db3 more than once",
        ),
        (f"  relative_file_paths: [a.db3]\n{topics(101)}", "the limit is 100"),
        (
            f"  relative_file_paths: [{', '.join(f'a{i}.db3' for i in range(101))}]\n" + topics(1),
            "the limit is 100",
        ),
        (f"  relative_file_paths: [a.db3]\n{topics(1, '/t' * 1000)}", "2,001 characters"),
    ],
)
def test_metadata_that_would_cost_long_work_is_refused(
    text: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "MAX_BAG_ENTRIES", 100)
    (tmp_path / "metadata.yaml").write_text(HEAD + text)
    with pytest.raises(DataError, match=said):
        read_metadata(tmp_path)


def nested(levels: int, field: str) -> str:
    parts = [f"p/T1[{field}] x"]
    parts += [f"MSG: p/T{level}\np/T{level + 1}[{field}] x" for level in range(1, levels)]
    parts.append(f"MSG: p/T{levels}\nuint8 x")
    return f"\n{'=' * 80}\n".join(parts)


@pytest.mark.parametrize(
    ("definition", "said"),
    [
        (nested(8, "1000"), "more than 100,000 values"),
        (nested(40, "2"), "more than 100,000 values"),
        (f"p/E[100000000] x\n{'=' * 80}\nMSG: p/E\n", "more than 100,000 values"),
        (f"p/E[] x\n{'=' * 80}\nMSG: p/E\np/T[] y", "contains itself"),
    ],
)
def test_a_type_of_very_many_values_is_refused(definition: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        ros1._converter("p/msg/T", definition, "p/msg/T")


def test_types_as_they_are_used_are_accepted() -> None:
    ros1._converter(
        "p/msg/T", "float64[36] covariance\nuint8[1000000] data\nstring[] names", "p/msg/T"
    )
