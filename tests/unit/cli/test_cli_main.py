"""The command line as a whole: verbs, help, options, completion, errors and exit statuses."""

from __future__ import annotations

import os
import pty
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import get_args

import click
import msgspec
import pytest

from command_line import Call
from example_spec import example
from r2bspec.cli import main as cli
from r2bspec.cli.docs import docs_folder
from r2bspec.errors import ExitStatus, R2bspecError, UsageError
from r2bspec.judge.verdict import EXIT_CODES, OverallOutcome, Verdict
from r2bspec.report.findings_text import code_with_slug

VERBS = list(cli.VERBS)


def test_a_folder_in_place_of_one_spec_is_answered_with_its_specs(
    tmp_path: Path, call: Call
) -> None:
    (spec := tmp_path / "a.r2b.yaml").write_text("")
    assert f"is a folder: name one spec, such as {spec}" in call("plan", tmp_path, status=2).err


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("a.r2b.yaml", "specs/a.r2b.yaml"),
        ("spces/a.r2b.yaml", "specs/a.r2b.yaml"),
        ("specs/A.r2b.yml", "specs/a.r2b.yaml"),
        ("other/b.r2b.yaml", "../other/b.r2b.yaml"),
        ("/".join(["x"] * 2000), ""),
    ],
)
@pytest.mark.parametrize("verb", ["validate", "run", "plan", "tune", "judge", "trend", "import"])
def test_a_path_that_leads_to_nothing_is_answered_with_the_path_that_works(
    verb: str,
    written: str,
    meant: str,
    tmp_path: Path,
    call: Call,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    here = tmp_path / "here"
    for spec in (here / "specs/a.r2b.yaml", tmp_path / "other/b.r2b.yaml"):
        spec.parent.mkdir(parents=True)
        spec.touch()
    monkeypatch.chdir(here)
    # What is imported is a document with findings.
    said = " ".join(call(verb, written, status=1 if verb == "import" else 2).err.split())
    assert f"did you mean '{meant}'?" in said if meant else "relative to the current folder" in said


@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_has_at_most_18_options(verb: str) -> None:
    """Of those that click knows, with the hidden ones and --help; of a group those of a verb."""
    context = click.Context(cli.command, **cli.command.context_settings)
    top = cli.command.get_command(context, verb)
    subs = top.commands.values() if isinstance(top, click.Group) else [top]
    for command in subs:
        assert command is not None
        options = [each for each in command.get_params(context) if isinstance(each, click.Option)]
        assert len(options) <= 18, command.name


def test_there_are_at_most_17_verbs() -> None:
    assert len(VERBS) <= 17


def folder_of_a_stranger(folder: Path, names: set[str]) -> None:
    """A folder with a module of each of these names, and of all that r2bspec depends on."""
    packages = {"click", "yaml", "numpy", "msgspec", "rich", "platformdirs", "sitecustomize"}
    for name in names | packages:
        (folder / f"{name}.py").write_text("raise SystemExit('the module of a stranger')\n")


@pytest.mark.parametrize(
    "command",
    [[str(Path(sys.executable).with_name("r2bspec"))], [sys.executable, "-P", "-m", "r2bspec"]],
    ids=["script", "-P"],
)
def test_the_command_does_not_look_into_the_current_folder(
    command: list[str], tmp_path: Path
) -> None:
    folder_of_a_stranger(tmp_path, set(sys.stdlib_module_names) | {"r2bspec"})
    for asked in (["--version"], ["docs", "R2B101"]):
        done = subprocess.run(
            [*command, *asked], capture_output=True, text=True, check=False, cwd=tmp_path
        )
        assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help(verb: str, call: Call) -> None:
    assert call(verb, "-h", status=0).out.startswith(f"Usage: r2bspec {verb}")


def test_the_help_lists_every_verb_and_every_status(call: Call) -> None:
    shown = call("--help", status=0).out
    assert all(f"\n  {verb}" in shown for verb in VERBS)
    words = " ".join(shown.split())
    assert all(f"{each.value} {each.meaning}" in words for each in ExitStatus)


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
    def fail(_: object) -> None:
        raise error

    monkeypatch.setattr(cli.command, "invoke", fail)
    shown = call("validate", status=status).err
    assert "Traceback" not in shown
    if isinstance(error, R2bspecError):
        assert f"error[{code_with_slug(error.code)}]: {error}" in shown
        assert error.hint in shown


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_any_verb_as_interrupted(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch, call: Call
) -> None:
    def interrupted(_: object) -> int:
        os.kill(os.getpid(), number)
        time.sleep(60)
        return 0

    before = signal.getsignal(number)
    monkeypatch.setattr(cli.command, "invoke", interrupted)
    assert call("validate", status=130).err == "interrupted\n"
    assert signal.getsignal(number) is before


# Every exit status has its number and its meaning.


ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("outcome", ["pass", "fail", "inconclusive", "invalid"])
def test_the_page_on_verdicts_has_their_statuses(outcome: OverallOutcome) -> None:
    text = (ROOT / "docs" / "verdicts.md").read_text(encoding="utf-8")
    row = rf"^\| {outcome.upper()} \| .* \| {EXIT_CODES[outcome].value} \|$"
    assert re.search(row, text, re.MULTILINE)


def test_every_outcome_has_a_status_and_is_stored_as_a_number() -> None:
    assert set(EXIT_CODES) == set(get_args(OverallOutcome))
    for outcome, status in EXIT_CODES.items():
        verdict = Verdict(
            outcome=outcome, exit_code=status, reason="", requirements=(), unusable=()
        )
        assert f'"exit_code":{status.value},'.encode() in msgspec.json.encode(verdict)


@pytest.mark.parametrize("closed", ["2>&-", ">&- 2>&- <&-"])
@pytest.mark.parametrize(("words", "status"), [("validate none.r2b.yaml", 2), ("init", 0)])
def test_a_stream_that_is_closed_changes_neither_status_nor_files(
    words: str, status: int, closed: str, tmp_path: Path
) -> None:
    """A file that is opened would get its number, and all that is printed."""
    program = shlex.quote(sys.executable)
    ended = subprocess.run(
        ["/bin/sh", "-c", f"{program} -m r2bspec {words} {closed}"],
        cwd=tmp_path,
        capture_output=True,
        check=False,
    )
    assert ended.returncode == status, ended.stderr
    texts = [file.read_text() for file in tmp_path.iterdir()]
    assert len(texts) == (1 if words == "init" else 0)
    assert not any("created my_benchmark" in text for text in texts)


def test_a_reader_that_ends_is_no_error_of_the_input() -> None:
    asked = [sys.executable, "-m", "r2bspec", "docs", "--schema", "spec"]
    with subprocess.Popen(
        asked,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == ExitStatus.OUTPUT_CLOSED


@pytest.mark.parametrize(
    "words", [("validate", ""), ("plan", "a.r2b.yaml", "-o", ""), ("init", "--from-bag", "")]
)
def test_an_empty_argument_is_refused(words: tuple[str, ...], call: Call) -> None:
    assert "is empty" in call(*words, status=2).err


# What a shell proposes, and the pages that are installed.


@pytest.fixture
def proposed(call: Call, monkeypatch: pytest.MonkeyPatch) -> Callable[..., set[str]]:
    """What r2bspec proposes for the last of some words, as bash asks for it."""

    def asked(*words: str) -> set[str]:
        monkeypatch.setenv("_R2BSPEC_COMPLETE", "bash_complete")
        monkeypatch.setenv("COMP_WORDS", " ".join(["r2bspec", *words]))
        monkeypatch.setenv("COMP_CWORD", str(len(words)))
        said = call(status=0)
        assert said.err == ""
        return {line.partition(",")[2] for line in said.out.splitlines() if line}

    return asked


def test_verbs_templates_codes_datasets_and_formats_are_proposed(
    proposed: Callable[..., set[str]],
) -> None:
    assert {"run", "report"} <= proposed("r")
    assert "minimal" in proposed("init", "--template", "m")
    assert {"R2B204", "R2B207"} <= proposed("docs", "R2B20")
    assert "remapping-unmatched" in proposed("docs", "remapping")
    assert {"latency.p99", "latency.p99_9"} <= proposed("docs", "latency.p99")
    assert "r2b_storage" in proposed("data", "verify", "r2b_")
    assert {"html="} == proposed("run", "a.r2b.yaml", "--report", "h")


def test_cases_and_variables_of_the_spec_are_proposed(
    proposed: Callable[..., set[str]], tmp_path: Path
) -> None:
    spec = tmp_path / "a.r2b.yaml"
    matrix = "variables: {threads: 1}\nmatrix: {axes: {threads: [1, 2]}}\n"
    spec.write_text(example() + matrix)
    assert proposed("run", str(spec), "--case", "") == {"threads=1", "threads=2", "all"}
    assert proposed("plan", str(spec), "--var", "t") == {"threads="}
    none = str(tmp_path / "none.r2b.yaml")
    assert proposed("run", none, "--case", "t") == set(), "nothing, where nothing can be read"


def test_every_page_of_the_documentation_is_listed_and_printed(call: Call) -> None:
    listed = {line.split()[0] for line in call("docs", status=0).out.splitlines()}
    folder = docs_folder()
    pages = {file.relative_to(folder).with_suffix("").as_posix() for file in folder.rglob("*.md")}
    assert listed == pages
    assert {"language", "running", "metrics"} <= listed
    assert call("docs", "metrics", status=0).out.startswith("# Metrics\n")
    assert call("docs", "proofs/verdicts", status=0).out.startswith("# Proofs of the verdicts")
    assert Path(call("docs", "running", "--path", status=0).out.strip()).is_file()
    assert "did you mean running?" in call("docs", "runing", status=2).err
    assert (
        "verdicts: Which test decides which requirement\n" in call("docs", "Binomial", status=0).out
    )


def test_a_terminal_that_is_closed_is_an_interruption() -> None:
    script = (
        "import signal, sys; import r2bspec.cli.main as cli\n"
        "def wait(_):\n    print('ready', flush=True)\n    signal.pause()\n"
        "cli._called = wait\nsys.exit(cli.main(['validate']))\n"
    )
    process, terminal = pty.fork()
    if not process:
        os.execv(sys.executable, [sys.executable, "-c", script])  # noqa: S606
    while b"ready" not in os.read(terminal, 1000):
        pass
    os.close(terminal)
    assert os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 130


def test_a_folder_that_leads_to_itself_is_wrong_usage(tmp_path: Path, call: Call) -> None:
    (tmp_path / "loop").symlink_to("loop")
    spec = Path(__file__).parents[3] / "specs/relay.r2b.yaml"
    for words in (
        ("run", spec, "--output", tmp_path / "loop/out"),
        ("run", spec, spec, "--output", tmp_path / "loop/out"),
        ("compare", spec, "--against", f"env:{tmp_path}/loop/setup.bash"),
    ):
        assert "[R2B69" not in call(*words, status=2).err
