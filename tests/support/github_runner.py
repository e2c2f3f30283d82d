"""Workflows and actions of GitHub, run as its runner does: expressions, steps, outputs, conditions.

What a runner has and these tests need: contexts, the operators of expressions, the functions of
status, composite actions with their inputs, and the files by which steps talk to the runner. A step
that uses the action of this repository runs the steps of `action.yml`; a checkout is made by git.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import gettempdir
from typing import Any

import yaml

from git_repositories import git
from pipelines import ACTION, Workplace, read_outputs

_WORD = re.compile(
    r"(?P<operator>\|\||&&|==|!=|!|\(|\))|'(?P<text>(?:[^']|'')*)'|(?P<number>-?\d+)"
    r"|(?P<status>[a-z]+)\(\)|(?P<path>[A-Za-z_][\w.-]*)"
)
_PYTHON = {"||": " or ", "&&": " and ", "!": "~"}
"""Operators in Python, where ``~`` binds as ``!`` does."""
_CONSTANTS = {"true": True, "false": False, "null": None}
_EXPRESSION = re.compile(r"\$\{\{(.*?)\}\}", re.DOTALL)
_OF_STATUS = re.compile(r"\b(always|cancelled|failure|success)\(\)")

Value = Any
"""A value of an expression: a string, a number, a Boolean, None or a mapping."""


class ExpressionError(Exception):
    """An expression that a runner would refuse."""


@dataclass(frozen=True, eq=False)
class _Operand:
    """A part of an expression; what is missing equals an empty text."""

    value: Value

    def __bool__(self) -> bool:
        return bool(self.value)

    def __eq__(self, other: object) -> Any:
        same = (
            isinstance(other, _Operand) and _text(self.value).lower() == _text(other.value).lower()
        )
        return _Operand(same)

    def __ne__(self, other: object) -> Any:
        return ~(self == other)

    def __invert__(self) -> _Operand:
        return _Operand(not self.value)


def evaluate(text: str, contexts: Mapping[str, Value], *, failed: bool = False) -> Value:
    """The value of an expression.

    Raises:
        ExpressionError: it is malformed, or names a context that does not exist.
    """
    statuses = {"always": True, "cancelled": False, "failure": failed, "success": not failed}
    operands: list[_Operand] = []

    def translated(word: re.Match[str]) -> str:
        if word["operator"]:
            return _PYTHON.get(word["operator"], word["operator"])
        if word["text"] is not None:
            value: Value = word["text"].replace("''", "'")
        elif word["number"]:
            value = int(word["number"])
        elif word["status"]:
            value = statuses[word["status"]]
        else:
            value = _property(word["path"], contexts)
        operands.append(_Operand(value))
        return f"operands[{len(operands) - 1}]"

    try:
        python = _WORD.sub(translated, text)
        result: _Operand = eval(python.strip(), {"operands": operands})  # noqa: S307 - our own words
    except (SyntaxError, KeyError) as error:
        raise ExpressionError(text) from error
    return result.value


def _property(path: str, contexts: Mapping[str, Value]) -> Value:
    """The value of a path such as ``github.event.name``; raises KeyError without its context."""
    if path in _CONSTANTS:
        return _CONSTANTS[path]
    context, *names = path.split(".")
    value: Value = contexts[context]
    for name in names:
        value = value.get(name) if isinstance(value, Mapping) else None
    return value


def expand(text: object, contexts: Mapping[str, Value]) -> str:
    """A text with the values of its expressions."""
    return _EXPRESSION.sub(lambda match: _text(evaluate(match[1], contexts)), str(text))


def _text(value: Value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return "" if value is None else str(value)


@dataclass(frozen=True)
class Event:
    """What starts a workflow.

    Attributes:
        name: of the event.
        ref: what is checked out.
        payload: ``github.event``.
    """

    name: str
    ref: str
    payload: Mapping[str, Any]


def pull_request_of(repository: Path, base: str, head: str, merge: str) -> Event:
    """The pull request 1 of a repository, which checks out the merge of its head with its base."""
    git(repository, "update-ref", "refs/pull/1/merge", merge)
    git(repository, "config", "uploadpack.allowAnySHA1InWant", "true")
    pull_request = {
        "number": 1,
        "base": {"sha": base, "ref": "main"},
        "head": {"sha": head, "repo": {"full_name": "owner/robot"}},
    }
    return Event("pull_request", "refs/pull/1/merge", {"pull_request": pull_request})


@dataclass
class Job:
    """A job that has run.

    Attributes:
        failed: whether a step failed.
        printed: what all steps printed.
        outputs: those of each step that has an id.
        uploaded: the folders that were uploaded.
        summary: of all steps.
        skipped: the names of steps whose condition did not hold.
    """

    failed: bool = False
    printed: str = ""
    outputs: dict[str, dict[str, str]] = field(default_factory=dict)
    uploaded: list[Path] = field(default_factory=list)
    summary: str = ""
    skipped: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Runner:
    """A machine with a new folder for each job.

    Attributes:
        folder: receives checkouts and files of the runner.
        origin: the repository that is checked out.
        inputs: of the action, which a test sets besides those of the workflow.
        environment: variables of all steps.
    """

    folder: Path
    origin: str
    inputs: Mapping[str, str] = field(default_factory=dict)
    environment: Mapping[str, str] = field(default_factory=dict)

    @property
    def checkout(self) -> Path:
        """The work tree of the job."""
        return self.folder / "checkout"

    def run(self, workflow: str, event: Event, variables: Mapping[str, str] | None = None) -> Job:
        """Run the only job of a workflow."""
        shutil.rmtree(self.folder, ignore_errors=True)
        (self.folder / "temp").mkdir(parents=True)
        self.checkout.mkdir()
        document = yaml.safe_load(workflow)
        # YAML 1.1 reads the key 'on' as true.
        started_by = document[True]
        assert event.name in started_by, (event.name, started_by)
        ((job_id, definition),) = document["jobs"].items()
        github = {
            "event": event.payload,
            "event_name": event.name,
            "ref": event.ref,
            "repository": "owner/robot",
            "token": "ghs_of_the_job",
            "workflow": document["name"],
            "job": job_id,
        }
        job = Job()
        contexts = {"github": github, "vars": variables or {}, "env": {}, "inputs": None}
        self._run_steps(definition["steps"], contexts, job)
        return job

    def _run_steps(
        self, steps: list[dict[str, Any]], contexts: Mapping[str, Value], job: Job
    ) -> dict[str, dict[str, Any]]:
        """Run steps; returns the context of their outputs."""
        done: dict[str, dict[str, Any]] = {}
        failed = False
        for step in steps:
            here = {**contexts, "steps": done}
            condition = _EXPRESSION.sub(r"\1", str(step.get("if", "success()")))
            holds = evaluate(condition, here, failed=failed)
            if not holds or (failed and not _OF_STATUS.search(condition)):
                job.skipped.append(step.get("name") or step.get("uses", ""))
                continue
            code, outputs = self._run_step(step, here, job)
            failed = failed or code != 0
            if identifier := step.get("id"):
                done[identifier] = {"outputs": outputs}
                job.outputs[identifier] = outputs
        job.failed = job.failed or failed
        return done

    def _run_step(
        self, step: dict[str, Any], contexts: Mapping[str, Value], job: Job
    ) -> tuple[int, dict[str, str]]:
        given = {name: expand(value, contexts) for name, value in step.get("with", {}).items()}
        used = step.get("uses", "").partition("@")[0]
        if not used:
            variables = {
                name: expand(value, contexts) for name, value in step.get("env", {}).items()
            }
            return self._run_script(expand(step["run"], contexts), variables, contexts, job)
        uses: dict[str, Callable[[], tuple[int, dict[str, str]]]] = {
            "actions/checkout": lambda: self._check_out(contexts, int(given.get("fetch-depth", 1))),
            "actions/upload-artifact": lambda: self._upload(Path(given["path"]), job),
            "r2bspec/r2bspec": lambda: self._act(given, contexts, job),
        }
        return uses[used]()

    def _act(
        self, given: Mapping[str, str], contexts: Mapping[str, Value], job: Job
    ) -> tuple[int, dict[str, str]]:
        """The steps of the action of this repository."""
        unknown = set(given) - set(ACTION["inputs"])
        assert not unknown, unknown
        defaults = {name: str(about.get("default", "")) for name, about in ACTION["inputs"].items()}
        inputs = {**defaults, **given, **self.inputs}
        # A composite action sees neither the variables of the repository nor other steps.
        inner = {"github": contexts["github"], "inputs": inputs, "env": {}}
        inside = Job()
        done = self._run_steps(ACTION["runs"]["steps"], inner, inside)
        job.printed += inside.printed
        job.summary += inside.summary
        job.skipped += inside.skipped
        outputs = {
            name: expand(about["value"], {**inner, "steps": done})
            for name, about in ACTION["outputs"].items()
        }
        return int(inside.failed), outputs

    def _run_script(
        self,
        script: str,
        variables: Mapping[str, str],
        contexts: Mapping[str, Value],
        job: Job,
    ) -> tuple[int, dict[str, str]]:
        temp = self.folder / "temp"
        output, summary = temp / "output", temp / "summary"
        for file in (output, summary):
            file.write_text("")
        github = contexts["github"]
        values = {
            "GITHUB_ACTION_PATH": str(Path(__file__).parents[2]),
            "GITHUB_API_URL": "https://api.github.com",
            "GITHUB_EVENT_NAME": github["event_name"],
            "GITHUB_JOB": github["job"],
            "GITHUB_OUTPUT": str(output),
            "GITHUB_REPOSITORY": github["repository"],
            "GITHUB_RUN_ID": "4711",
            "GITHUB_SERVER_URL": "https://github.com",
            "GITHUB_STEP_SUMMARY": str(summary),
            "GITHUB_WORKFLOW": github["workflow"],
            "GITHUB_WORKSPACE": str(self.checkout),
            "RUNNER_TEMP": str(temp),
            # That of a job is not as deep in folders as one of a test.
            "TMPDIR": gettempdir(),
        }
        place = Workplace(self.checkout, temp)
        code, printed = place.shell("bash", script, **{**values, **self.environment, **variables})
        job.printed += printed
        job.summary += summary.read_text()
        return code, read_outputs(output.read_text())

    def _check_out(self, contexts: Mapping[str, Value], depth: int) -> tuple[int, dict[str, str]]:
        reference = contexts["github"]["ref"]
        git(self.checkout, "init", "--quiet")
        git(self.checkout, "remote", "add", "origin", self.origin)
        limit = [f"--depth={depth}"] * bool(depth)
        what = f"+{reference}:{reference}"
        git(self.checkout, "fetch", "--quiet", "--no-tags", *limit, "origin", what)
        git(self.checkout, "checkout", "--quiet", "--detach", reference)
        return 0, {}

    @staticmethod
    def _upload(place: Path, job: Job) -> tuple[int, dict[str, str]]:
        assert place.is_dir(), place
        job.uploaded.append(place)
        return 0, {}
