"""The command line as a whole: verbs, help, errors and exit statuses."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import r2bspec.cli as verbs_package
from command_line import Call
from r2bspec._version import __version__
from r2bspec.cli import main as cli
from r2bspec.errors import R2bspecError, UsageError
from r2bspec.report.findings_text import code_with_slug

VERBS = list(cli.VERBS)


def test_the_module_is_the_command() -> None:
    asked = [sys.executable, "-m", "r2bspec", "--version"]
    done = subprocess.run(asked, capture_output=True, text=True, check=True)
    assert done.stdout == f"r2bspec {__version__}\n"


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_a_stream_that_the_caller_has_closed_is_an_empty_one(closed: str, tmp_path: Path) -> None:
    """Otherwise a file that is opened gets its number, and all that is printed."""
    asked = f"'{sys.executable}' -m r2bspec init {closed}"
    command = ["sh", "-c", asked]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert (done.returncode, "Traceback" in done.stderr) == (0, False)
    assert "created" not in (tmp_path / "my_benchmark.r2b.yaml").read_text()


def test_a_folder_in_place_of_one_spec_is_answered_with_its_specs(
    tmp_path: Path, call: Call
) -> None:
    (spec := tmp_path / "a.r2b.yaml").write_text("")
    assert f"is a folder: name one spec, such as {spec}" in call("plan", tmp_path, status=2).err


def folder_of_a_stranger(folder: Path, names: set[str]) -> None:
    """A folder with a module of each of these names, and of all that r2bspec depends on."""
    packages = {"click", "yaml", "numpy", "msgspec", "rich", "platformdirs", "sitecustomize"}
    for name in names | packages:
        (folder / f"{name}.py").write_text("raise SystemExit('the module of a stranger')\n")


def test_the_module_imports_nothing_from_the_current_folder(tmp_path: Path) -> None:
    # What Python itself imports for -m, before any line of r2bspec is executed, is not for
    # r2bspec to decide; nor is what it takes for r2bspec.
    folder_of_a_stranger(tmp_path, set(sys.stdlib_module_names) - {"contextlib", "importlib"})
    asked = [sys.executable, "-m", "r2bspec", "explain", "R2B101"]
    done = subprocess.run(asked, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    "command",
    [[str(Path(sys.executable).with_name("r2bspec"))], [sys.executable, "-P", "-m", "r2bspec"]],
    ids=["script", "-P"],
)
def test_the_command_does_not_look_into_the_current_folder(
    command: list[str], tmp_path: Path
) -> None:
    folder_of_a_stranger(tmp_path, set(sys.stdlib_module_names) | {"r2bspec"})
    for asked in (["--version"], ["explain", "R2B101"]):
        done = subprocess.run(
            [*command, *asked], capture_output=True, text=True, check=False, cwd=tmp_path
        )
        assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help(verb: str, monkeypatch: pytest.MonkeyPatch, call: Call) -> None:
    # click keeps the help option of the first call; one that another test made without the group
    # has other names. So the verb is imported anew, and the one that others use is put back.
    name = cli._PLACES.get(verb, verb).partition(":")[0]
    monkeypatch.delitem(sys.modules, f"r2bspec.cli.{name}", raising=False)
    monkeypatch.setattr(verbs_package, name, None, raising=False)
    shown = call(verb, "--help", status=0).out
    assert shown.startswith(f"Usage: r2bspec {verb}")
    assert "-h, --help" in shown


def test_the_help_lists_every_verb(call: Call) -> None:
    shown = call("--help", status=0).out
    assert all(f"\n  {verb}" in shown for verb in VERBS)
    assert "3 inconclusive" in shown


def test_a_misspelt_verb_is_answered_with_the_right_one(call: Call) -> None:
    assert "did you mean 'validate'?" in call("vlidate", status=2).err


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (UsageError("no such thing", hint="try another"), 2),
        (R2bspecError("it broke"), 4),
        (KeyboardInterrupt(), 130),
    ],
)
def test_an_error_is_a_line_a_hint_and_a_status(
    error: BaseException, status: int, monkeypatch: pytest.MonkeyPatch, call: Call
) -> None:
    def fail(**_: object) -> None:
        raise error

    monkeypatch.setattr(cli.command, "main", fail)
    shown = call("validate", status=status).err
    assert "Traceback" not in shown
    if isinstance(error, R2bspecError):
        assert f"error[{code_with_slug(error.code)}]: {error}" in shown
        assert error.hint in shown


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_any_verb_as_interrupted(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch, call: Call
) -> None:
    def interrupted(**_: object) -> int:
        os.kill(os.getpid(), number)
        time.sleep(60)
        return 0

    before = signal.getsignal(number)
    monkeypatch.setattr(cli.command, "main", interrupted)
    assert call("validate", status=130).err == "interrupted\n"
    assert signal.getsignal(number) is before


def test_an_interrupt_while_modules_are_imported_is_silent() -> None:
    code = (
        "import builtins, os, signal\n"
        "imports = builtins.__import__\n"
        "def interrupt(name, *arguments):\n"
        "    if name == 'click':\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "    return imports(name, *arguments)\n"
        "builtins.__import__ = interrupt\n"
        "from r2bspec.__main__ import start\n"
        "start()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (-signal.SIGINT, b"")
