"""The scripts of the GitHub action and of the GitLab template, run as a pipeline would."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).parents[2]

ACTION: dict[str, Any] = yaml.safe_load((ROOT / "action.yml").read_text())
STEPS: dict[str, Any] = {step["name"]: step for step in ACTION["runs"]["steps"]}
TEMPLATE = ROOT / "ci" / "gitlab" / "r2bspec.gitlab-ci.yml"
JOB: dict[str, Any] = yaml.safe_load(TEMPLATE.read_text())[".r2bspec"]


_STAND_IN = Path(__file__).with_name("stand_in.sh").read_text(encoding="utf-8")


def stand_in(folder: Path) -> Path:
    """A program in place of Python with r2bspec, where what r2bspec does is not examined.

    It ends with ``$STATUS``, and keeps its arguments and its environment in the current folder.
    """
    program = folder / "fake python"
    program.write_text(_STAND_IN.replace("$PYTHON", sys.executable))
    program.chmod(0o755)
    return program


@dataclass(frozen=True)
class Ended:
    """A pipeline that has ended."""

    code: int
    printed: str
    outputs: dict[str, str]
    summary: str


@dataclass(frozen=True)
class Workplace:
    """A checkout, and the folder of the runner beside it."""

    checkout: Path
    runner: Path

    def write(self, name: str, text: str) -> Path:
        path = self.checkout / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path

    def shell(self, shell: str, script: str, **variables: str) -> tuple[int, str]:
        """As a runner does: fail on the first error, and on errors in pipes."""
        options = ["-e"] if shell == "sh" else ["--noprofile", "--norc", "-eo", "pipefail"]
        done = subprocess.run(
            [shutil.which(shell) or shell, *options, "-c", script],
            cwd=self.checkout,
            env={**os.environ, "TMPDIR": str(self.runner), **variables},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            check=False,
        )
        return done.returncode, done.stdout.decode(errors="replace")

    def action(
        self,
        python: str,
        spec: str,
        base: str = "",
        *,
        given_base: str = "",
        allow: str = "",
        arguments: str = "",
        inconclusive: str = "fail",
        **variables: str,
    ) -> Ended:
        """Run the benchmark as the action does, in a pull request with a base if there is one.

        Args:
            python: has r2bspec.
            spec: that is run.
            base: of the pull request.
            given_base: the input ``base``; other inputs have their names.
            allow: an input.
            arguments: an input.
            inconclusive: an input.
            variables: of the environment.
        """
        step = STEPS["Run the benchmark"]
        inputs = {"python": python, "spec": spec, "base": given_base, "allow": allow}
        inputs |= {"arguments": arguments, "inconclusive": inconclusive}
        contexts = {
            "inputs": inputs,
            "github": {"event": {"pull_request": {"base": {"sha": base}}}},
        }
        output, summary = self.runner / "output", self.runner / "summary"
        values = {
            **{name: _value(text, contexts) for name, text in step["env"].items()},
            "RUNNER_TEMP": str(self.runner),
            "GITHUB_WORKSPACE": str(self.checkout),
            "GITHUB_REPOSITORY": "owner/robot",
            "GITHUB_OUTPUT": str(output),
            "GITHUB_STEP_SUMMARY": str(summary),
        }
        code, printed = self.shell("bash", step["run"], **{**values, **variables})
        outputs = read_outputs(output.read_text()) if output.exists() else {}
        return Ended(code, printed, outputs, summary.read_text() if summary.exists() else "")

    def job(self, python: str, spec: str, shell: str = "bash", **variables: str) -> Ended:
        values = {
            **{name: str(value) for name, value in JOB["variables"].items()},
            "R2BSPEC_PYTHON": python,
            "R2BSPEC_SPEC": spec,
            "ROS_DISTRO": "none",
            "CI_PROJECT_DIR": str(self.checkout),
        }
        script = "\n".join([*JOB["before_script"], *JOB["script"]])
        code, printed = self.shell(shell, script, **{**values, **variables})
        return Ended(code, printed, {}, "")


def _value(expression: str, contexts: Mapping[str, Any]) -> str:
    """Return the first value that is not empty of an expression such as ``${{ a.b || a.c }}``."""
    for path in expression.removeprefix("${{").removesuffix("}}").split("||"):
        value: Any = contexts
        for name in path.strip().split("."):
            value = value.get(name) or {}
        if value:
            return str(value)
    return ""


def read_outputs(text: str) -> dict[str, str]:
    """Outputs of a step as a runner reads them: the last one of a name counts."""
    found: dict[str, str] = {}
    lines = iter(text.split("\n"))
    for line in lines:
        name, sign, end = line.partition("<<")
        if sign and "=" not in name:
            value: list[str] = []
            for part in lines:
                if part == end:
                    break
                value.append(part)
            found[name] = "\n".join(value)
        elif "=" in line:
            name, _, rest = line.partition("=")
            found[name] = rest
    return found
