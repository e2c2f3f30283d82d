"""The files that the processes of a graph really loaded: ``loaded_files.json`` in a run folder.

The identity of a graph says what its nodes are made of, from looking at them. This says what was in
their processes: mapped files (programs, libraries, extension modules) and, of Python nodes, the
modules. A node that took a module from elsewhere shows here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

import msgspec

from r2bspec.record.atomic_files import write_atomically
from r2bspec.record.errors import RecordError
from r2bspec.safe_io.safe_json import read_json

LOADED_FILES: Final = "loaded_files.json"


def write_loaded_files(folder: Path, files: Mapping[str, Iterable[str]]) -> None:
    """Write the absolute paths of the files that each process has loaded, by its name.

    Raises:
        RecordError: the file cannot be written.
    """
    content = {name: sorted(files[name]) for name in sorted(files)}
    text = msgspec.json.format(msgspec.json.encode(content), indent=1)
    write_atomically(folder / LOADED_FILES, text + b"\n")


def read_loaded_files(folder: Path) -> dict[str, tuple[str, ...]]:
    """The files that each process of a run has loaded, by its name; empty if that is not known.

    Raises:
        RecordError: the file is damaged.
    """
    path = folder / LOADED_FILES
    try:
        return read_json(path, dict[str, tuple[str, ...]])
    except FileNotFoundError:
        return {}
    except (OSError, msgspec.DecodeError, ValueError) as error:
        raise RecordError(
            f"{path} is damaged: {error}",
            hint="The folder was changed after the run, or was not written by r2bspec.",
        ) from error
