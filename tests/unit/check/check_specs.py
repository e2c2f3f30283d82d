"""Short ways to a checked spec."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from r2bspec.check import check
from r2bspec.diagnostics import Diagnostic
from r2bspec.language.load_spec import load_spec

STRING = "std_msgs/msg/String"
START_NS = 1_700_000_000_000_000_000


def findings(text: str, *, file: str = "spec.r2b.yaml", offline: bool = False) -> list[Diagnostic]:
    """Everything that is said about a spec."""
    return check(load_spec(text, file=file, environ={}), offline=offline)


def codes(text: str, *, file: str = "spec.r2b.yaml", offline: bool = False) -> list[str]:
    """The codes of that, in the order of the document."""
    return [each.code for each in findings(text, file=file, offline=offline)]


def write_bag(folder: Path, times_ns: dict[str, Iterable[int]]) -> Path:
    """A bag of strings, recorded at the given ns after START_NS."""
    typestore = get_typestore(Stores.ROS2_JAZZY)
    data = bytes(typestore.serialize_cdr(typestore.types[STRING](data="x"), STRING))
    with Writer(folder, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, times in times_ns.items():
            connection = writer.add_connection(topic, STRING, typestore=typestore)
            for time_ns in times:
                writer.write(connection, START_NS + time_ns, data)
    return folder
