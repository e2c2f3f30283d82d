"""A program in Python names its modules when it exits, and is otherwise left alone."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import r2bspec
from r2bspec.execute.identity.loaded_files import modules_of_programs

FOLDER = Path(r2bspec.__file__).parent / "harness" / "module_names"


def run(
    tmp_path: Path, program: str, *options: str, before: str = "", after: str = ""
) -> subprocess.CompletedProcess[str]:
    """Run a program as a process of a graph, with further folders before and after ours."""
    folders = [folder for folder in (before, str(FOLDER), after, str(tmp_path)) if folder]
    names = {"R2BSPEC_MODULES_FOLDER": str(tmp_path / "names")}
    return subprocess.run(
        [sys.executable, *options, "-c", program],
        env={"PYTHONPATH": os.pathsep.join(folders), **names},
        capture_output=True,
        text=True,
        check=False,
        start_new_session=True,
        cwd=tmp_path,
    )


@pytest.fixture(autouse=True)
def gains(tmp_path: Path) -> Path:
    file = tmp_path / "gains.py"
    file.write_text("GAIN = 2\n")
    return file


def custom(tmp_path: Path, text: str) -> str:
    """A folder with a `sitecustomize` of the user."""
    folder = tmp_path / "user"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(text)
    return str(folder)


def named(tmp_path: Path) -> frozenset[str]:
    """What programs have named, all together."""
    return frozenset().union(*modules_of_programs(tmp_path / "names").values())


def test_modules_are_named_under_the_session_of_the_process(tmp_path: Path, gains: Path) -> None:
    # A wrapper starts the program; the variables reach it, and so does the session.
    program = (
        "import os, subprocess, sys; print(os.getsid(0), flush=True); "
        "subprocess.run([sys.executable, '-c', 'import gains'])"
    )
    done = run(tmp_path, program)
    modules = modules_of_programs(tmp_path / "names")
    assert [*modules] == [int(done.stdout)]
    assert str(gains) in modules[int(done.stdout)]


def test_a_script_is_named_too(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text("import os; os.chdir('/')\n")
    run(tmp_path, "import subprocess, sys; subprocess.run([sys.executable, 'script.py'])")
    assert str(tmp_path / "script.py") in named(tmp_path)


@pytest.mark.parametrize("place", ["before", "after"])
def test_what_the_user_customizes_is_there(tmp_path: Path, gains: Path, place: str) -> None:
    folder = custom(tmp_path, "import builtins; builtins.CUSTOM = __file__\n")
    program = "import gains, sys; print(CUSTOM); print(sys.modules['sitecustomize'].__file__)"
    done = run(tmp_path, program, **{place: folder})
    assert done.stdout.split() == [f"{folder}/sitecustomize.py"] * 2
    assert done.stderr == ""
    # Where that of the user comes first, it alone is imported.
    assert (str(gains) in named(tmp_path)) == (place == "after")


def test_the_search_path_is_that_of_the_user(tmp_path: Path) -> None:
    done = run(tmp_path, "import sys; print(*sys.path, sep='\\n')")
    assert str(FOLDER) not in done.stdout.splitlines()
    assert str(tmp_path) in done.stdout.splitlines()
