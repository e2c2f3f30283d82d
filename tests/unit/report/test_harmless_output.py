"""No text of a stranger reaches a terminal or a log as a control sequence or a command."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from command_line import Call
from example_spec import example
from r2bspec.compare.comparison import ComparedSource, Comparison, ComparisonLine
from r2bspec.compare.report_input import ReportInput
from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.diagnostics.plain_text import escaped_json
from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.judge.result import Result
from r2bspec.record.graph_identity import GraphIdentity, Revision
from r2bspec.report import finding_formats
from r2bspec.report.format_registry import FORMATS, renderer
from r2bspec.report.output import echo

PACKAGE = Path(__file__).parents[3] / "r2bspec"

ATTACK = (
    "\x1b]0;owned\x07\x1b[2J\x9b31m\u202eevil\u2066\r"
    "::error::first\n::stop-commands::x\n  ::add-mask::y\n##[add-path]z\x00\x7f\u2028::w"
)
OURS = re.compile(r"::(?:error|warning|notice) [^\n]*::")
CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\u2028]")


def check_harmless(text: str, *, commands: bool = False) -> None:
    assert not CONTROL.search(text.replace("\r\n", "\n"))
    assert "\r" not in text.replace("\r\n", "\n")
    for line in re.split(r"[\n\r\x85\u2028]", text):
        if line.lstrip().startswith("::"):
            assert commands, line
            assert OURS.match(line), line
        assert "##[" not in line


def attacked(value: Any) -> Any:
    """The same value with the attack in every text and every key that a format leaves free."""
    if isinstance(value, msgspec.Struct):
        kinds = {field.name: field.type for field in msgspec.structs.fields(value)}
        return msgspec.structs.replace(
            value,
            **{
                name: attacked(getattr(value, name))
                for name in value.__struct_fields__
                if "Literal" not in str(kinds[name])
                # What says which calculation it was, and the keys that other fields refer to.
                and name not in {"method", "unit", "metric", "monitor", "pace", "spec"}
            },
        )
    if isinstance(value, dict):
        return {key: attacked(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return type(value)([attacked(each) for each in value])
    return value + ATTACK if isinstance(value, str) else value


@pytest.fixture
def hostile(reported: Callable[[str], ReportInput]) -> Result:
    revision = Revision(commit="0" * 40, dirty=True, name="<script>")
    base = GraphIdentity(digest="", nodes={}, packages={}, revision=revision)
    compared = {
        "identity": base,
        "base_identity": base,
        "changes": ("<b> changed",),
        "gate": ("y",),
    }
    result = msgspec.structs.replace(reported("usual").result, **compared)
    return attacked(result)  # type: ignore[no-any-return]


@pytest.mark.parametrize("name", sorted(FORMATS.keys() - {"json", "samples"}))
def test_no_report_of_a_hostile_result_does_harm(name: str, hostile: Result) -> None:
    shown = renderer(name)(ReportInput(result=hostile)).decode()
    check_harmless(shown, commands=name == "github")
    assert "stop-commands" in shown
    assert name not in {"markdown", "html", "junit"} or "<b>" not in shown


@pytest.mark.parametrize("name", ["text", "markdown"])
def test_no_comparison_of_hostile_results_does_harm(name: str) -> None:
    from r2bspec.report.comparison_document import render

    source = ComparedSource(source=ATTACK, name=ATTACK, run_id=ATTACK, started_at=ATTACK)
    numbers = dict.fromkeys(("base", "head", "ratio", "lower", "upper", "offered_hz"), 1.0)
    line = ComparisonLine(
        **numbers,
        monitor=ATTACK,
        metric=ATTACK,
        unit="s",
        margin=0.1,
        outcome="worse",
        reason=ATTACK,
    )
    made = Comparison(
        base=source, head=source, confidence=0.95, differences=(ATTACK,), lines=(line,)
    )
    check_harmless(render([made], name).decode())


FINDING = Diagnostic(
    "R2B204",
    Severity.ERROR,
    ATTACK,
    Span(f"::add-mask::{ATTACK}", 1, 1, 1, 4),
    help=ATTACK,
)


@pytest.mark.parametrize("name", ["text", "github", "junit"])
@pytest.mark.parametrize("colour", [True, False])
def test_no_finding_does_harm(name: str, colour: bool, capsys: pytest.CaptureFixture[str]) -> None:
    file = FINDING.span.file
    sources = {file: f"::error::{ATTACK}\n"}
    shown = finding_formats.render(name, [FINDING], sources, [file], colour=colour)
    echo(shown, styled=colour and name == "text", commands=name == "github")
    printed = capsys.readouterr().out
    check_harmless(re.sub(r"\x1b\[[0-9;]*m", "", printed), commands=name == "github")
    assert "add-mask" in printed


def test_a_file_with_a_hostile_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: Call
) -> None:
    monkeypatch.chdir(tmp_path)
    name = "::add-mask::\x1b[2J.r2b.yaml"
    Path(name).write_text(example().replace("R2B", "x") + "nonsense: 1\n")
    for each in ("text", "github", "junit"):
        shown = call("validate", "--format", each, "--offline", name)
        check_harmless(shown.out, commands=each == "github")
        assert "add-mask" in shown.out
    for verb in ("plan", "judge", "run"):
        shown = call(verb, name)
        check_harmless(shown.out + shown.err)
        assert "add-mask" in shown.err


def test_errors_are_harmless(monkeypatch: pytest.MonkeyPatch, call: Call) -> None:
    def fail(_: object) -> None:
        raise R2bspecError(ATTACK, hint=ATTACK)

    call(f"::error::{ATTACK}")
    monkeypatch.setattr("r2bspec.cli.main._called", fail)
    shown = call().err
    assert shown.count("stop-commands") >= 2
    check_harmless(shown)


_ALLOWED = {"report/output.py", "doctor/import_probe.py", "pytest_plugin.py"}


def test_nothing_else_writes_text() -> None:
    found = []
    for module in PACKAGE.rglob("*.py"):
        name = module.relative_to(PACKAGE).as_posix()
        if name in _ALLOWED or name.startswith(("harness/", "nodes/")):
            continue
        text = module.read_text(encoding="utf-8")
        if not re.search(r"print|echo|Console|sys\.std(out|err)", text):
            continue  # to parse every module takes seconds
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Call):
                called = ast.unparse(node.func)
                if called in {"print", "click.echo", "click.secho", "Console"} or re.fullmatch(
                    r"sys\.std(out|err)\.write", called
                ):
                    found.append(f"{name}:{node.lineno}: {called}")
    assert found == []


def test_no_document_of_a_hostile_result_controls_a_terminal(hostile: Result) -> None:
    shown = renderer("json")(ReportInput(result=hostile)).decode()
    assert not CONTROL.search(shown)
    assert msgspec.json.decode(shown)


HOSTILE_SPEC = (
    example()
    .replace("name: example", 'name: example\nlabels: {a: "a\\x9b31m\\u202eb\\e]0;x\\a"}')
    .encode()
)


def test_a_plan_has_no_control_characters_wherever_it_goes(tmp_path: Path, call: Call) -> None:
    spec = tmp_path / "relay.r2b.yaml"
    spec.write_bytes(HOSTILE_SPEC)
    file = tmp_path / "plan"
    call("plan", spec, "-o", file, status=0)
    printed = call("plan", spec, status=0).out
    assert printed == file.read_text(encoding="utf-8")
    assert not CONTROL.search(printed)
    assert "\\u202e" in printed
    drawings = (["--graph", each] for each in ("mermaid", "html"))
    for options in drawings:
        call("plan", spec, *options, "-o", file, status=0)
        assert not CONTROL.search(file.read_text(encoding="utf-8"))
    plain_spec = tmp_path / "plain.r2b.yaml"
    plain_spec.write_text(example(), encoding="utf-8")
    call("plan", spec, "--diff", plain_spec, "-o", file)
    assert not CONTROL.search(file.read_text(encoding="utf-8"))


@pytest.mark.parametrize("arguments", [("validate",), ("judge",), ("data", "info"), ()])
def test_an_error_about_a_long_name_keeps_its_reason(
    arguments: tuple[str, ...], call: Call
) -> None:
    reasons = (
        "does not exist",
        "File name too long",
        "has 100,000 characters",
        "verbs: init",
        "is not a folder",
    )
    shown = call(*arguments, "x" * 100_000, status=ExitStatus.USAGE)
    assert len(shown.out + shown.err) < 2_000
    assert any(reason in shown.err for reason in reasons)


@pytest.mark.parametrize("text", ["##[group]", "a ##vso[task.x]", "####[x", "# [x", "##"])
def test_json_in_a_log_is_no_command_of_its_runner(text: str) -> None:
    document = msgspec.json.encode({text: [text]})
    shown = escaped_json(document)
    assert not re.search(rb"##\w*\[", shown)
    assert msgspec.json.decode(shown) == {text: [text]}
