"""Archives, in which specs travel to a host and run folders back, and the errors of a fleet.

The format is ZIP: it allows random access and has regular files only, so that no link can be made.
"""

from __future__ import annotations

import io
import os
import shutil
import stat
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Final

from r2bspec.diagnostics.quote import quote
from r2bspec.errors import ExitStatus, R2bspecError, UsageError
from r2bspec.language.quantities import Size
from r2bspec.safe_io.file_search import regular_files
from r2bspec.safe_io.limits import MAX_FLEET_ARCHIVE_BYTES, MAX_FLEET_ARCHIVE_FILES


class FleetError(R2bspecError):
    """The fleet cannot be used, or a run on a host failed."""

    code = "R2B682"
    way_out = "See the log of its worker; run again with --resume."


class NoHostError(UsageError):
    """No host of the fleet meets the requirements of a run."""

    code = "R2B683"


class ArchiveError(UsageError):
    """The files of a spec or a run folder cannot travel."""

    code = "R2B686"
    way_out = "Send fewer or smaller files, or play the spec on the host itself."


class HostLostError(FleetError):
    """The hosts of a run left the fleet, or the scheduler did."""

    code = "R2B688"
    way_out = "Start its worker or the scheduler again, and run with --resume."


class HostRunError(FleetError):
    """A run on a host ended without a result."""

    def __init__(self, message: str, *, status: ExitStatus, code: str, hint: str) -> None:
        super().__init__(message, hint=hint, code=code)
        self.exit_code = status


_COMPRESSION: Final = 1
"""Samples and logs shrink to a fraction even so."""


def pack(contents: Mapping[str, Path | bytes]) -> bytes:
    """Return an archive of files, or of bytes, by their paths in it.

    Raises:
        ArchiveError: they are too many or too large.
    """
    sizes = {
        path: len(content) if isinstance(content, bytes) else content.stat().st_size
        for path, content in contents.items()
    }
    _check_size(sizes)
    stream = io.BytesIO()
    with zipfile.ZipFile(
        stream, "w", zipfile.ZIP_DEFLATED, compresslevel=_COMPRESSION, strict_timestamps=False
    ) as archive:
        for path, content in contents.items():
            if isinstance(content, bytes):
                archive.writestr(path, content)
            else:
                archive.write(content, path)
    return stream.getvalue()


def pack_folder(folder: Path) -> bytes:
    """Return an archive of the regular files of a folder; links stay behind.

    Raises:
        ArchiveError: they are too many or too large.
    """
    files = (file for file in sorted(regular_files(folder)) if not file.is_symlink())
    return pack({str(file.relative_to(folder)): file for file in files})


def unpack(archive: bytes, folder: Path) -> None:
    """Write the files of an archive below a folder.

    Raises:
        ArchiveError: it is damaged or too large, or a path leads out of the folder.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(archive)) as content:
            entries = [entry for entry in content.infolist() if not entry.is_dir()]
            _check_size({entry.filename: entry.file_size for entry in entries})
            for entry in entries:
                target = _target(folder, entry.filename)
                target.parent.mkdir(parents=True, exist_ok=True)
                with content.open(entry) as source, target.open("xb") as copy:
                    shutil.copyfileobj(source, copy)
                if entry.external_attr >> 16 & stat.S_IXUSR:
                    target.chmod(target.stat().st_mode | stat.S_IXUSR)
    except (zipfile.BadZipFile, zlib.error, EOFError, ValueError, FileExistsError) as error:
        raise ArchiveError(f"an archive of the fleet is damaged: {error}") from error


def _target(folder: Path, name: str) -> Path:
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or not path.parts:
        raise ArchiveError(f"the path {quote(name)} leads out of its archive")
    return folder.joinpath(*path.parts)


def _check_size(sizes: Mapping[str, int]) -> None:
    if sum(sizes.values()) > MAX_FLEET_ARCHIVE_BYTES or len(sizes) > MAX_FLEET_ARCHIVE_FILES:
        largest = max(sizes, key=lambda path: sizes[path])
        raise ArchiveError(
            f"the files have more than {Size(MAX_FLEET_ARCHIVE_BYTES)} or are more than "
            f"{MAX_FLEET_ARCHIVE_FILES:,}; the largest is {os.path.basename(largest)}",  # noqa: PTH119
            hint="Put large recordings on the hosts, and name them by absolute paths.",
        )
