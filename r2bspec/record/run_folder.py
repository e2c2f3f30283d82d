"""The run folder: writing it during a run, and opening it afterwards.

`r2bspec.record.run_record` describes the layout. Every file is written atomically. A folder with
``record.json`` is a run folder: that file is written last, and also earlier, marked as incomplete,
so that a killed run can be read.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Final, Self

import msgspec
import numpy as np

from r2bspec.plan.canonical_json import PlanError, parse_plan
from r2bspec.plan.plan import Plan
from r2bspec.record import sample_arrays as arrays
from r2bspec.record.files import (
    LOCK_FILE,
    RUN_FILES,
    RUN_UNWRITABLE,
    FolderLock,
    FolderReader,
    FolderTakenError,
    RecordError,
    to_json,
    write_atomically,
)
from r2bspec.record.run_record import RunRecord, Segment
from r2bspec.safe_io.limits import MAX_DOCUMENT_BYTES, MAX_SEGMENTS
from r2bspec.safe_io.safe_file import is_folder, is_there, read_text
from r2bspec.safe_io.safe_yaml import RefusedYamlError, check_document

LOADED_FILES: Final = "loaded_files.json"

RECORD_FILES: Final = ("record.json", "pairs.json", "suite.json", "tuning.json")
"""Each makes its folder that of a run, a comparison, a suite or a search."""
FOLDER_ENTRIES: Final = frozenset(
    {
        *RECORD_FILES,
        *("spec.yaml", "plan.json", "base.plan.json", "result.json", "baseline.json"),
        *("samples", "logs", "profile", "base", "head", "trials"),
        *(
            "resources.npy",
            "interference.npy",
            "devices.npy",
            "anatomy.npy",
            LOADED_FILES,
            LOCK_FILE,
        ),
    }
)
"""The names that are not for reports in such a folder."""

_OTHER_FOLDERS: Final = {
    "suite.json": ("suite", ("*/record.json", "*/pairs.json"), ""),
    "pairs.json": (
        "comparison",
        ("head/*/record.json", "base/*/record.json"),
        " For all of it: 'judge', 'report' and 'compare'.",
    ),
    "tuning.json": ("search", ("trials/*/record.json", "trials/*/pairs.json"), ""),
}
"""What a folder with a file is that is no run, where its runs are, and what else reads it."""

_MAX_LISTED = 10
_MAX_LOOKED_AT = 1_000


_FOLDER_MODE = 0o700
"""Recorded images and logs are not for other users of the machine."""

_SAFE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+=@-]*")


class RunFolder:
    """A run folder that is being written.

    A folder from `create` belongs to this run alone until `release`, or the end of a ``with``
    block.

    Attributes:
        path: the folder, absolute.
    """

    def __init__(self, path: Path, lock: FolderLock | None = None) -> None:
        self.path = path
        self._lock = lock
        self._digests: dict[str, str] = {}

    @classmethod
    def create(cls, path: Path) -> Self:
        """Create the folder and its parents, and take its lock.

        Raises:
            FolderTakenError: it is not empty, or belongs to a run in progress, so that two runs
                never mix.
            RecordError: the file system refuses.
        """
        path = path.absolute()
        try:
            path.mkdir(mode=_FOLDER_MODE, parents=True, exist_ok=True)
            if set(os.listdir(path)) - {LOCK_FILE}:  # noqa: PTH208
                raise _taken(path, "is not empty")
            lock = FolderLock(path)
            # Another run may have had the lock, and ended, since the look at the content.
            if set(os.listdir(path)) - {LOCK_FILE}:  # noqa: PTH208
                lock.release()
                raise _taken(path, "is not empty")
        except BlockingIOError as error:
            raise _taken(path, "belongs to a run that is in progress") from error
        except OSError as error:
            raise RecordError(
                f"{path} cannot be created: {error.strerror or error}",
                hint="Choose another folder with --output.",
                code=RUN_UNWRITABLE,
            ) from error
        return cls(path, lock)

    def release(self) -> None:
        """Release the folder: the run has ended, and nothing more is written."""
        if self._lock is not None:
            self._lock.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def log_path(self, process: str) -> Path:
        """Return the path of the log of a process; its folder is created."""
        path = self.path / "logs" / f"{_safe_name(process)}.log"
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def profile_folder(self, process: str) -> Path:
        """Return the folder for the files of a profiler about a process, after creating it."""
        path = self.path / "profile" / _safe_name(process)
        path.mkdir(mode=_FOLDER_MODE, parents=True, exist_ok=True)
        return path

    @property
    def ros_logs(self) -> Path:
        """The folder for log files that ROS processes write themselves."""
        return self.path / "logs" / "ros"

    def write_spec(self, text: str) -> None:
        """Write the resolved spec."""
        write_atomically(self.path / "spec.yaml", text.encode())

    def write_plan(self, text: str) -> None:
        """Write the canonical JSON of the plan."""
        write_atomically(self.path / "plan.json", text.encode())

    def write_rows(
        self, kind: arrays.SampleKind, rows: arrays.Rows, segment: str = "", monitor: str = ""
    ) -> None:
        """Write samples of a segment, or of the whole run; those of a monitor with its name."""
        file = arrays.sample_file(kind, _safe_name(monitor) if kind == "monitor" else "")
        place = file if kind in arrays.OF_RUN else f"{_samples_of(segment)}/{file}"
        self._digests[place] = arrays.write_rows(self.path / place, rows, arrays.DTYPES[kind])

    def write_record(self, record: RunRecord) -> None:
        """Write ``record.json``, with the digests of its samples.

        It may be written repeatedly during the run.
        """
        covered = {_samples_of(segment.id) for segment in record.segments}
        if record.status != "incomplete":
            covered.add("")
        digests = {
            place: digest
            for place, digest in (record.samples | self._digests).items()
            if place.rpartition("/")[0] in covered
        }
        record = msgspec.structs.replace(record, samples=digests)
        write_atomically(self.path / "record.json", to_json(record))

    def write_result(self, content: bytes) -> None:
        """Write ``result.json``."""
        write_atomically(self.path / "result.json", content)


@dataclass(frozen=True)
class Run:
    """An opened run folder: its plan and its measurements.

    The samples are read on request, segment by segment.
    """

    folder: Path
    record: RunRecord
    plan: Plan

    def playback(self, segment: Segment) -> arrays.Rows:
        """Return the playback, a row for each step (type `PLAYBACK_DTYPE`).

        Raises:
            RecordError: the file is missing or damaged.
        """
        return self.segment_rows(segment, "playback")

    def work(self, segment: Segment) -> arrays.Rows:
        """Return the processor time of each step and process.

        No rows if nothing was played by a player.

        Raises:
            RecordError: the file is missing or damaged.
        """
        if f"{_samples_of(segment.id)}/work.npy" not in self.record.samples:
            return np.empty(0, arrays.WORK_DTYPE)
        return self.segment_rows(segment, "work")

    def monitor(self, segment: Segment, name: str) -> arrays.Rows:
        """Return the messages of a monitor in order of arrival (type `MONITOR_DTYPE`).

        Raises:
            RecordError: the file is missing or damaged.
        """
        return self.segment_rows(segment, "monitor", name)

    def anatomy(self, segment: Segment) -> arrays.Rows:
        """Return the events in the processes of the graph, in the order in which they began.

        Raises:
            RecordError: the file is missing or damaged.
        """
        return self.segment_rows(segment, "anatomy")

    def has_anatomy(self, segment: Segment) -> bool:
        """Return True if a segment was observed from inside."""
        return f"{_samples_of(segment.id)}/anatomy.npy" in self.record.samples

    def segment_rows(
        self, segment: Segment, kind: arrays.SampleKind, monitor: str = ""
    ) -> arrays.Rows:
        """Return the samples of a kind in a segment.

        Raises:
            RecordError: the file is missing or damaged.
        """
        file = arrays.sample_file(kind, _safe_name(monitor) if monitor else "")
        return self._rows(f"{_samples_of(segment.id)}/{file}", arrays.DTYPES[kind])

    def _rows(self, place: str, dtype: np.dtype[np.void]) -> arrays.Rows:
        """Return the rows of a file, which is compared with its digest in the record.

        Raises:
            RecordError: it is missing, damaged, or not in the record.
        """
        if place not in self.record.samples:
            raise RecordError(
                f"{self.folder / 'record.json'} is damaged: it has no digest of {place}",
                hint=RUN_FILES.changed,
            )
        return arrays.read_rows(self.folder / place, dtype, self.record.samples[place])

    def resources(self) -> arrays.Rows:
        """Return CPU and memory samples (type `RESOURCE_DTYPE`); no rows if there are none.

        Raises:
            RecordError: the file is damaged.
        """
        return self._of_run("resources")

    def interference(self) -> arrays.Rows:
        """Return host interference (type `INTERFERENCE_DTYPE`); no rows if it was not sampled.

        Raises:
            RecordError: the file is damaged.
        """
        return self._of_run("interference")

    def devices(self) -> arrays.Rows:
        """Return samples of GPUs and packages (type `DEVICE_DTYPE`); no rows if there are none.

        Raises:
            RecordError: the file is damaged.
        """
        return self._of_run("devices")

    def _of_run(self, kind: arrays.SampleKind) -> arrays.Rows:
        name, dtype = arrays.sample_file(kind), arrays.DTYPES[kind]
        path = self.folder / name
        if name in self.record.samples:
            return self._rows(name, dtype)
        if not os.path.lexists(path):
            return np.empty(0, dtype)
        # A run that was killed had no time for the digests of what grew to its end.
        return (
            arrays.read_rows(path, dtype)
            if self.record.status == "incomplete"
            else self._rows(name, dtype)
        )

    def unlisted_segments(self) -> list[str]:
        """Return the names of segments with samples in the folder that the record does not list."""
        listed = {segment.id for segment in self.record.segments}
        samples = self.folder / "samples"
        stored = {place.name for place in samples.iterdir()} if is_folder(samples) else set()
        return sorted(stored - listed)

    def spec_text(self) -> str:
        """Return the resolved spec, as YAML; empty if the folder has none."""
        return read_spec_text(self.folder / "spec.yaml")


def open_run(path: Path) -> Run:
    """Open a finished run.

    Raises:
        RecordError: the folder does not exist or is not a run folder, or its files are damaged or
            have an unknown format version.
    """
    folder = path.absolute()
    if not is_folder(folder):
        raise RecordError(
            f"{path} is not a folder", hint="Give a run folder, which contains record.json."
        )
    for file, (what, places, advice) in _OTHER_FOLDERS.items():
        if not is_there(folder / file):
            continue
        runs = _runs_below(path, *places)
        raise RecordError(
            f"{path} is the folder of a {what}, not of a run",
            hint=f"Name a run of it: {runs}.{advice}"
            if runs
            else f"Nothing was played in it; {file} says why.",
        )
    if not is_there(folder / "record.json"):
        raise RecordError(
            f"{path} is not a run folder: it has no record.json",
            hint=f"Name a run in it: {runs}."
            if (runs := _runs_below(path, "*/record.json"))
            else "A run that was killed before its first record leaves only logs and samples.",
        )
    path = folder / "record.json"
    record = RUN_FILES.versioned(path, RunRecord, "r2bspec_record")
    if len(record.segments) > MAX_SEGMENTS:
        raise RecordError(
            f"{path} lists {len(record.segments):,} segments; the limit is {MAX_SEGMENTS:,}",
            hint="Play fewer iterations or rates in one run: split the spec.",
        )
    # Each segment has samples of its own: a short record must not have a few read many times.
    RUN_FILES.require_once(path, "segment", (segment.id for segment in record.segments))
    _check_samples(folder, record)
    plan = read_stored_plan(RUN_FILES, folder / "plan.json", record.plan_hash)
    return Run(folder=folder, record=record, plan=plan)


def _runs_below(path: Path, *records: str) -> str:
    """Return the first folders below one that have such a record."""
    folder = path.absolute()
    found = [
        place.parent
        for record in records
        for place in sorted(islice(folder.glob(record), _MAX_LOOKED_AT))
    ]
    return ", ".join(str(path / place.relative_to(folder)) for place in found[:_MAX_LISTED])


def _check_samples(folder: Path, record: RunRecord) -> None:
    """Compare the segments with the digests of samples; each file is when it is read.

    Raises:
        RecordError: samples and segments do not correspond, or those of a segment are missing.
    """
    listed = {segment.id for segment in record.segments}
    stored = {place.split("/")[1] for place in record.samples if "/" in place}
    if differing := sorted(listed ^ stored):
        raise RecordError(
            f"{folder / 'record.json'} is damaged: it does not list both segment and samples of "
            f"{', '.join(map(repr, differing[:_MAX_LISTED]))}",
            hint=RUN_FILES.changed,
        )
    for segment in sorted(stored):
        if not is_folder(folder / _samples_of(segment)):
            raise RecordError(
                f"the samples of segment {segment!r} are missing: there is no folder "
                f"{folder / _samples_of(segment)}",
                hint=RUN_FILES.changed,
            )


def read_stored_plan(files: FolderReader, path: Path, expected_hash: str) -> Plan:
    """Return the plan of a stored run or comparison.

    Raises:
        RecordError: it cannot be read, is damaged, or is another plan.
    """
    content = files.content(path)
    # Of the file: a plan of an older version is encoded anew with the fields of this one.
    if expected_hash != f"sha256:{hashlib.sha256(content).hexdigest()}":
        raise RecordError(f"{path} is not the plan of this {files.what}", hint=files.changed)
    try:
        return parse_plan(content, str(path))
    except PlanError as error:
        raise RecordError(str(error), hint=files.changed) from error


def read_spec_text(path: Path) -> str:
    """Return the resolved spec of a run or comparison; empty if the folder has none.

    Raises:
        RecordError: it is no regular file, too large, not UTF-8, or no YAML within the limits.
    """
    try:
        text = read_text(path, max_bytes=MAX_DOCUMENT_BYTES, folders=(path.parent,))
        check_document(text)
    except FileNotFoundError:
        return ""
    except RefusedYamlError as error:
        raise RecordError(f"{path} is damaged: {error}", hint=RUN_FILES.changed) from error
    except OSError as error:
        raise RecordError(
            f"{path} cannot be read: {error.strerror or error}", hint=RUN_FILES.changed
        ) from error
    return text


def write_loaded_files(folder: Path, files: Mapping[str, Iterable[str]]) -> None:
    """Write the absolute paths of the files that each process has loaded, by its name.

    Raises:
        RecordError: the file cannot be written.
    """
    content = {name: sorted(files[name]) for name in sorted(files)}
    write_atomically(folder / LOADED_FILES, to_json(content))


def read_loaded_files(folder: Path) -> dict[str, tuple[str, ...]]:
    """Return the files that each process of a run has loaded, by its name.

    Empty if unknown.

    Raises:
        RecordError: the file is damaged.
    """
    return RUN_FILES.optional(folder / LOADED_FILES, dict[str, tuple[str, ...]]) or {}


def _samples_of(segment: str) -> str:
    return f"samples/{_safe_name(segment)}"


def _taken(path: Path, why: str) -> FolderTakenError:
    return FolderTakenError(
        f"{path} {why}",
        hint="Each run needs a folder of its own: choose a new one with --output.",
    )


def _safe_name(name: str) -> str:
    """Check that a name can be a file name in the run folder."""
    if _SAFE_NAME.fullmatch(name) is None:
        raise RecordError(f"{name!r} cannot be part of a file name in a run folder")
    return name
