"""The storage formats of bags that can be read: another one is an entry here and its module.

It is part of the language, whose descriptions name the formats, and imports none of the modules
that read them.
"""

from __future__ import annotations

from typing import Final

import msgspec


class BagFormat(msgspec.Struct, frozen=True):
    """One storage format.

    Attributes:
        name: as metadata.yaml calls it.
        title: as its users call it.
        suffix: of its files.
        reader: ``module:class`` in `r2bspec.bags.storage`, a `Storage` that opens one file.
        folders: whether rosbag2 records folders of such files.
        note: what is to be said of every bag of this format.
    """

    name: str
    title: str
    suffix: str
    reader: str
    folders: bool = True
    note: str = ""


BAG_FORMATS: Final = (
    BagFormat(
        name="sqlite3",
        title="sqlite3",
        suffix=".db3",
        reader="sqlite:SqliteStorage",
    ),
    BagFormat(name="mcap", title="MCAP", suffix=".mcap", reader="mcap:McapStorage"),
    BagFormat(
        name="ros1",
        title="ROS 1",
        suffix=".bag",
        reader="ros1:Ros1Storage",
        folders=False,
        note="recorded by ROS 1: messages are converted to those of ROS 2",
    ),
)


def format_of_suffix(suffix: str) -> BagFormat | None:
    """The format of the files with a suffix, or None."""
    return next((each for each in BAG_FORMATS if each.suffix == suffix), None)


def folder_format_names() -> list[str]:
    """The names of the formats of which rosbag2 records folders, sorted."""
    return sorted(each.name for each in BAG_FORMATS if each.folders)


def _one_of(words: list[str]) -> str:
    return f"{', '.join(words[:-1])} or {words[-1]}"


SUFFIXES_TEXT: Final = _one_of([each.suffix for each in BAG_FORMATS])
"""The suffixes in words, such as ``.a, .b or .c``."""
