"""The run folder: writing one during a run, and opening one afterwards.

`r2bspec.record.run_record` describes the layout. Every file appears whole or not at all, and
``record.json`` is what makes a folder a run: it is written last, and may be written earlier as
incomplete so that a killed run still counts as one.
"""

from __future__ import annotations

import hashlib
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import msgspec
import numpy as np

from r2bspec.plan.canonical_json import parse_plan
from r2bspec.plan.errors import PlanError
from r2bspec.plan.plan import Plan
from r2bspec.plan.taps import tap_name
from r2bspec.record.atomic_files import write_atomically
from r2bspec.record.errors import RUN_UNWRITABLE, RecordError
from r2bspec.record.run_record import RunRecord, Segment
from r2bspec.record.sample_arrays import (
    INTERFERENCE_DTYPE,
    MONITOR_DTYPE,
    PLAYBACK_DTYPE,
    RESOURCE_DTYPE,
    Rows,
    read_rows,
    write_rows,
)
from r2bspec.untrusted.safe_file import is_folder, read_bytes, read_text
from r2bspec.untrusted.safe_json import MAX_JSON_BYTES, decode_json

FORMAT_VERSION = 1

_MAX_SPEC_BYTES = 10_000_000

_CHANGED_HINT = "The folder was changed after the run, or is not one that r2bspec wrote."

_SAFE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+=@-]*")


class RunFolder:
    """A run folder that is being written.

    Attributes:
        path: the folder, absolute.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    @classmethod
    def create(cls, path: Path) -> Self:
        """Make the folder and its parents.

        Raises:
            RecordError: it exists and is not empty, so that two runs never mix; or the file
                system refuses.
        """
        path = path.absolute()
        try:
            path.mkdir(parents=True, exist_ok=True)
            occupied = any(path.iterdir())
        except OSError as error:
            raise RecordError(
                f"{path} cannot be made: {error.strerror or error}",
                hint="Choose another folder with --output.",
                code=RUN_UNWRITABLE,
            ) from error
        if occupied:
            raise RecordError(
                f"{path} is not empty",
                hint="Each run needs a folder of its own: choose a new one with --output.",
                code=RUN_UNWRITABLE,
            )
        return cls(path)

    def log_path(self, process: str) -> Path:
        """Where the output of a process goes; its folder exists afterwards."""
        path = self.path / "logs" / f"{_safe_name(process)}.log"
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    @property
    def ros_logs(self) -> Path:
        """Where ROS processes write the log files that they make themselves."""
        return self.path / "logs" / "ros"

    def write_spec(self, text: str) -> None:
        """Write the resolved spec."""
        write_atomically(self.path / "spec.yaml", text.encode())

    def write_plan(self, text: str) -> None:
        """Write the canonical JSON of the plan."""
        write_atomically(self.path / "plan.json", text.encode())

    def write_playback(self, segment: str, rows: Rows) -> None:
        """Write what was played in a segment: rows of `PLAYBACK_DTYPE`."""
        write_rows(_segment_folder(self.path, segment) / "playback.npy", rows, PLAYBACK_DTYPE)

    def write_monitor(self, segment: str, monitor: str, rows: Rows) -> None:
        """Write what a monitor received in a segment, also when it is nothing (no rows)."""
        write_rows(
            _segment_folder(self.path, segment) / _monitor_file(monitor), rows, MONITOR_DTYPE
        )

    def write_tap(self, segment: str, topic: str, rows: Rows) -> None:
        """Write what a tap saw of a topic in a segment."""
        write_rows(_segment_folder(self.path, segment) / _tap_file(topic), rows, MONITOR_DTYPE)

    def write_resources(self, rows: Rows) -> None:
        """Write CPU and memory over the whole run: rows of `sample_arrays.RESOURCE_DTYPE`."""
        write_rows(self.path / "resources.npy", rows, RESOURCE_DTYPE)

    def write_interference(self, rows: Rows) -> None:
        """Write host interference over the whole run: rows of `INTERFERENCE_DTYPE`."""
        write_rows(self.path / "surroundings.npy", rows, INTERFERENCE_DTYPE)

    def write_record(self, record: RunRecord) -> None:
        """Write ``record.json``; it may be written again as the run goes on."""
        text = msgspec.json.format(msgspec.json.encode(record), indent=1)
        write_atomically(self.path / "record.json", text + b"\n")

    def write_result(self, content: bytes) -> None:
        """Write ``result.json``."""
        write_atomically(self.path / "result.json", content)


@dataclass(frozen=True)
class Run:
    """A run folder that has been opened: what was planned, what was observed.

    The samples are read when they are asked for, segment by segment.
    """

    folder: Path
    record: RunRecord
    plan: Plan

    def playback(self, segment: Segment) -> Rows:
        """What was played, one row per step, of type `r2bspec.record.sample_arrays.PLAYBACK_DTYPE`.

        Raises:
            RecordError: the file is missing or damaged.
        """
        return read_rows(_segment_folder(self.folder, segment.id) / "playback.npy", PLAYBACK_DTYPE)

    def monitor(self, segment: Segment, name: str) -> Rows:
        """What a monitor received, one row per message in order of arrival (type `MONITOR_DTYPE`).

        Raises:
            RecordError: the file is missing or damaged.
        """
        return read_rows(
            _segment_folder(self.folder, segment.id) / _monitor_file(name), MONITOR_DTYPE
        )

    def tap(self, segment: Segment, topic: str) -> Rows:
        """What a tap saw of a topic, one row per message as they arrived (type `MONITOR_DTYPE`).

        Raises:
            RecordError: the file is missing or damaged.
        """
        return read_rows(_segment_folder(self.folder, segment.id) / _tap_file(topic), MONITOR_DTYPE)

    def resources(self) -> Rows:
        """CPU and memory samples (type `RESOURCE_DTYPE`); no rows if none were taken.

        Raises:
            RecordError: the file is damaged.
        """
        return self._read_optional("resources.npy", RESOURCE_DTYPE)

    def interference(self) -> Rows:
        """Host interference (type `INTERFERENCE_DTYPE`); no rows if it was not sampled.

        Raises:
            RecordError: the file is damaged.
        """
        return self._read_optional("surroundings.npy", INTERFERENCE_DTYPE)

    def _read_optional(self, name: str, dtype: np.dtype[np.void]) -> Rows:
        path = self.folder / name
        return read_rows(path, dtype) if os.path.lexists(path) else np.empty(0, dtype)

    def spec_text(self) -> str:
        """The resolved spec, as YAML; empty if the folder has none."""
        path = self.folder / "spec.yaml"
        return read_spec_text(path)


def open_run(path: Path) -> Run:
    """Open a finished run.

    Raises:
        RecordError: there is no such folder, it is no run folder, its files are damaged, or
            they were written in a format that this version does not know.
    """
    folder = path.absolute()
    if not is_folder(folder):
        raise RecordError(
            f"{path} is not a folder", hint="Name a run folder, the one that holds record.json."
        )
    if not (folder / "record.json").exists():
        raise RecordError(
            f"{path} is not a run folder: it holds no record.json",
            hint="A run that was killed before its first record leaves only logs and samples.",
        )
    content = _read(folder / "record.json")
    _check_version(folder / "record.json", content)
    record: RunRecord = _decode(folder / "record.json", content, RunRecord)
    return Run(folder=folder, record=record, plan=_open_plan(folder / "plan.json", record))


class _VersionHeader(msgspec.Struct):
    r2bspec_record: int


def _check_version(path: Path, content: bytes) -> None:
    """Tell a newer format from a broken one before anything else is decoded."""
    version = _decode(path, content, _VersionHeader).r2bspec_record
    if version != FORMAT_VERSION:
        raise RecordError(
            f"{path} has format version {version}; this r2bspec reads version {FORMAT_VERSION}",
            hint="Use the r2bspec that made the run, or a newer one.",
        )


def _open_plan(path: Path, record: RunRecord) -> Plan:
    """Read the plan, and see that it is the one that was carried out."""
    content = _read(path)
    if record.plan_hash != f"sha256:{hashlib.sha256(content).hexdigest()}":
        raise RecordError(f"{path} is not the plan that this run carried out", hint=_CHANGED_HINT)
    try:
        return parse_plan(content, str(path))
    except PlanError as error:
        raise RecordError(str(error), hint=_CHANGED_HINT) from error


def _read(path: Path) -> bytes:
    try:
        return read_bytes(path, max_bytes=MAX_JSON_BYTES)
    except OSError as error:
        raise RecordError(
            f"{path} cannot be read: {error.strerror or error}",
            hint="The run folder is not complete; run the benchmark again.",
        ) from error


def _decode(path: Path, content: bytes, kind: Any) -> Any:
    try:
        return decode_json(content, kind)
    except msgspec.DecodeError as error:
        raise RecordError(f"{path} is damaged: {error}", hint=_CHANGED_HINT) from error


def read_spec_text(path: Path) -> str:
    """The resolved spec of a run or comparison; empty if the folder has none.

    Raises:
        RecordError: it is no regular file, too large, or not UTF-8.
    """
    try:
        return read_text(path, max_bytes=_MAX_SPEC_BYTES, folders=(path.parent,))
    except FileNotFoundError:
        return ""
    except OSError as error:
        raise RecordError(
            f"{path} cannot be read: {error.strerror or error}", hint=_CHANGED_HINT
        ) from error


def _segment_folder(folder: Path, segment: str) -> Path:
    return folder / "samples" / _safe_name(segment)


def _monitor_file(name: str) -> str:
    return f"monitor.{_safe_name(name)}.npy"


def _tap_file(topic: str) -> str:
    return f"{_safe_name(tap_name(topic))}.npy"


def _safe_name(name: str) -> str:
    """A name that stays inside the run folder when it becomes a file name."""
    if _SAFE_NAME.fullmatch(name) is None:
        raise RecordError(f"{name!r} cannot be part of a file name in a run folder")
    return name
