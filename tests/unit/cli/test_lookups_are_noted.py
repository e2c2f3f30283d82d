"""Everything that a check looks up is noted, so that no report is kept that would be another now.

The calls of the operating system are watched while the examples of all rules are checked, and
compared with what was noted.
"""

from __future__ import annotations

import builtins
import io
import os
import posix
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import r2bspec
from r2bspec.check.rule_registry import all_rules
from r2bspec.cli.check_files import check_file
from r2bspec.cli.file_report import CheckOptions
from r2bspec.untrusted.looked_up_files import looked_up_files, note_lookup, shared_lookups

ROOT = Path(__file__).parents[3]
CALLS = ("stat", "lstat", "open", "listdir", "scandir", "readlink", "access", "statvfs")

OF_THE_MACHINE = ("/proc/", "/dev/", "/sys/")
"""Part of the name of the cache: it changes with the machine and with each start of its system."""
OF_PYTHON = (str(Path(r2bspec.__file__).parent), str(Path(os.__file__).parent), sys.base_prefix)
"""r2bspec and the standard library: likewise."""
VARIABLES_THAT_CHANGE_NOTHING = {
    "XDG_CACHE_HOME": "where indexes of bags are kept",
    "R2BSPEC_CACHE_HOME": "where datasets are kept",
}


class Watched(dict[str, str]):
    """The environment, with the names that were read."""

    def __init__(self, names: set[str]) -> None:
        super().__init__(os.environ)
        self.names = names

    def get(self, key: Any, default: Any = None) -> Any:
        self.names.add(key)
        return super().get(key, default)

    def __getitem__(self, key: str) -> str:
        self.names.add(key)
        return super().__getitem__(key)

    def __contains__(self, key: object) -> bool:
        self.names.add(str(key))
        return super().__contains__(key)


@contextmanager
def watching(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[set[str], set[str]]]:
    """The paths that the process asks the system for, and the variables that it reads."""
    paths: set[str] = set()
    names: set[str] = set()
    before = Path.cwd()

    def watched(call: Callable[..., Any]) -> Callable[..., Any]:
        def wrapper(path: Any = ".", *args: Any, **kwargs: Any) -> Any:
            if isinstance(path, str | bytes | os.PathLike):
                paths.add(os.path.normpath(before / os.fsdecode(path)))
            return call(path, *args, **kwargs)

        return wrapper

    with monkeypatch.context() as patch:
        for name in CALLS:
            for module in (os, posix):
                patch.setattr(module, name, watched(getattr(module, name)))
        patch.setattr(builtins, "open", watched(open))
        patch.setattr(io, "open", watched(io.open))
        patch.setattr(os, "environ", Watched(names))
        yield paths, names


def unnoticed(paths: set[str], noted: set[str]) -> set[str]:
    # Resolving a path asks for each folder on the way to it.
    on_the_way = {str(each) for path in noted for each in Path(path).parents}
    # The times of a folder change when a file appears in it, which is what importlib asks for.
    missing = {
        path for path in paths if str(Path(path).parent) in noted and not Path(path).exists()
    }
    return {
        path
        for path in paths - noted - on_the_way - missing
        if not path.startswith((*OF_THE_MACHINE, *OF_PYTHON)) and "__pycache__" not in path
    }


def examples() -> dict[str, str]:
    found = {}
    for rule in all_rules():
        for kind, text in (("failing", rule.failing), ("passing", rule.passing)):
            if text:
                found[f"{rule.slug}_{kind}"] = text
    return found


def test_all_examples_of_rules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = {}
    for folder in ("first", "second"):
        (tmp_path / folder).mkdir()
        files[folder] = [tmp_path / folder / f"{name}.r2b.yaml" for name in examples()]
        for file, text in zip(files[folder], examples().values(), strict=True):
            file.write_text(text)
    for file in files["first"]:
        # What is imported for a check is none of its lookups.
        check_file(str(file), CheckOptions())
    missed: dict[str, set[str]] = {}
    for file in files["second"]:
        with watching(monkeypatch) as (paths, names), looked_up_files() as seen:
            check_file(str(file), CheckOptions())
        left = unnoticed(paths, set(seen.files))
        left |= names - seen.variables.keys() - VARIABLES_THAT_CHANGE_NOTHING.keys()
        if left:
            missed[file.name] = left
        assert str(file) in seen.read
    assert missed == {}


def test_lookups_that_are_shared_are_noted_for_every_document(tmp_path: Path) -> None:
    specs = [tmp_path / "one.r2b.yaml", tmp_path / "two.r2b.yaml"]
    for each in specs:
        each.write_text((ROOT / "specs" / "apriltag_node.r2b.yaml").read_text())
    noted = []
    with shared_lookups():
        for each in specs:
            with looked_up_files() as seen:
                check_file(str(each), CheckOptions())
            noted.append((set(seen.files), set(seen.variables)))
    (one, variables), (two, same_variables) = noted
    assert variables == same_variables
    common = one & two
    assert any("rclpy" in path for path in common)
    assert {Path(path).parent for path in one ^ two} == {tmp_path}


def test_the_watch_sees_what_is_not_noted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "unnoticed").touch()
    with watching(monkeypatch) as (paths, names), looked_up_files() as seen:
        note_lookup(tmp_path / "noted")
        (tmp_path / "unnoticed").read_text()
        os.environ.get("UNNOTICED")
    assert unnoticed(paths, set(seen.files)) == {str(tmp_path / "unnoticed")}
    assert names - seen.variables.keys() == {"UNNOTICED"}
