"""Programs in C are compiled once, and a machine that cannot compile them says why."""

from __future__ import annotations

import os
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from r2bspec.native import build as native_build
from r2bspec.native.build import NOT_BUILT, BuildError, RosFiles, build, find_compiler, find_ros
from r2bspec.safe_io.cache_folder import passed_over

NO_ROS = RosFiles(prefixes=(), wheels=False)
ANSWER = '#include "answer.h"\n#include <stdio.h>\nint main(void) { return printf("%d", N) < 0; }\n'


@pytest.fixture
def source(tmp_path: Path) -> Path:
    find_compiler()
    folder = tmp_path / "source"
    folder.mkdir()
    (folder / "answer.h").write_text("#define N 42\n")
    path = folder / "answer.c"
    path.write_text(ANSWER)
    return path


@pytest.fixture(autouse=True)
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where results are kept."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(native_build, "_results", {})
    passed_over.clear()
    return tmp_path / "cache/r2bspec/native"


def compiled(source: Path) -> Path:
    return build("answer", [source], NO_ROS, kind="program", libraries=())


def anew(source: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What the next process gets."""
    monkeypatch.setattr(native_build, "_results", {})
    return compiled(source)


def output(program: Path) -> str:
    return subprocess.run([program], stdout=subprocess.PIPE, check=True, text=True).stdout


def test_a_program_is_compiled_once_unless_a_header_changes(
    source: Path, kept: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = compiled(source)
    made_ns = first.stat().st_mtime_ns
    again = anew(source, monkeypatch)
    assert (again, again.stat().st_mtime_ns) == (first, made_ns)
    source.with_name("answer.h").write_text("#define N 43\n")
    second = compiled(source)
    assert [output(first), output(second)] == ["42", "43"]
    # What is kept is private.
    for path in (first, first.parent, kept, kept.parent):
        assert path.stat().st_mode & 0o077 == 0


def test_builds_at_once_end_with_one_program(source: Path, kept: Path) -> None:
    with ThreadPoolExecutor(4) as pool:
        paths = set(pool.map(lambda _: compiled(source), range(8)))
    (path,) = paths
    assert output(path) == "42"
    assert [each.name for each in kept.iterdir()] == [path.parent.name]


def test_what_is_damaged_is_made_anew(
    source: Path, kept: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = compiled(source)
    program.rename(program.with_name("another"))
    again = anew(source, monkeypatch)
    assert (again, output(again)) == (program, "42")
    assert [each.name for each in kept.iterdir()] == [program.parent.name]


@pytest.mark.parametrize("place", ["for all", "a file"])
def test_a_cache_that_cannot_be_used_is_passed_over_with_one_note(
    place: str, source: Path, tmp_path: Path, kept: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if place == "for all":
        kept.mkdir(parents=True)
        kept.chmod(0o777)
    else:
        (tmp_path / "cache").write_text("")
    for path in (anew(source, monkeypatch), compiled(source)):
        assert output(path) == "42"
    (note,) = passed_over
    assert f"{kept} is not used" in note


def test_without_a_compiler_it_says_what_to_install(tmp_path: Path) -> None:
    with pytest.raises(BuildError, match="no C compiler: cc is not in PATH") as caught:
        find_compiler({"PATH": str(tmp_path)})
    assert caught.value.code == NOT_BUILT
    assert "apt install gcc" in caught.value.hint


def test_without_headers_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.prefix", str(tmp_path))
    with pytest.raises(BuildError, match=r"no include/rcl/rcl/rcl.h") as caught:
        find_ros({"AMENT_PREFIX_PATH": "/nowhere"})
    assert caught.value.code == NOT_BUILT
    assert "ros" in caught.value.hint


def test_a_sourced_ros_precedes_the_wheels(tmp_path: Path) -> None:
    (tmp_path / "include/rcl/rcl").mkdir(parents=True)
    (tmp_path / "include/rcl/rcl/rcl.h").touch()
    (tmp_path / "lib").mkdir()
    found = find_ros({"AMENT_PREFIX_PATH": f"/overlay:{tmp_path}"})
    assert not found.wheels
    assert found.include_folders() == [tmp_path / "include/rcl"]
    assert found.library_folders() == [tmp_path / "lib"]


def test_what_does_not_compile_is_not_kept(source: Path, kept: Path) -> None:
    source.write_text("int main(void) { return unknown; }\n")
    with pytest.raises(BuildError, match="unknown"):
        compiled(source)
    assert not [*kept.iterdir()]


@pytest.mark.parametrize(("compiler", "status"), [("true", 0), ("false", 1)])
def test_a_compiler_that_makes_nothing_is_named_with_what_it_did(
    source: Path, kept: Path, compiler: str, status: int
) -> None:
    command = find_compiler({**os.environ, "CC": compiler})
    with pytest.raises(BuildError, match=f"status {status} and printed nothing") as caught:
        build("answer", [source], NO_ROS, kind="program", compiler=command)
    assert "CC is not a C compiler" in caught.value.hint
    assert not [*kept.iterdir()]
