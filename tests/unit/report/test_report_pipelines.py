"""The GitHub action and the GitLab template: their scripts, run as a pipeline would."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[3]

FAKE = """#!/bin/bash
# Stands for the real command: keeps its arguments and writes the reports that were asked for.
printf '%s\\n' "$@" > arguments.txt
mkdir -p reports r2bspec-reports
while [ $# -gt 0 ]; do
  case "$2" in
    json=*) printf '{"verdict": {"outcome": "%s"}}' "$OUTCOME" > "${2#json=}" ;;
    markdown=*) echo "### summary" > "${2#markdown=}" ;;
    github=-) echo "::error file=a.r2b.yaml,line=9::too slow" ;;
  esac
  shift
done
exit "$STATUS"
"""

ACTION: dict[str, Any] = yaml.safe_load((ROOT / "action.yml").read_text())
STEPS: dict[str, Any] = {step["name"]: step for step in ACTION["runs"]["steps"]}


@pytest.fixture(name="folder")
def workplace(tmp_path: Path) -> Path:
    program = tmp_path / "bin" / "r2bspec"
    program.parent.mkdir()
    program.write_text(FAKE)
    program.chmod(0o755)
    return tmp_path


def bash(folder: Path, script: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """As a runner does: fail on the first error, and on errors in pipes."""
    environment = {**os.environ, "PATH": f"{folder / 'bin'}:{os.environ['PATH']}", **variables}
    return subprocess.run(
        [shutil.which("bash") or "bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", script],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def run_step(folder: Path, status: int, outcome: str, arguments: str = "") -> str:
    done = bash(
        folder,
        STEPS["Run the benchmark"]["run"],
        R2BSPEC_SPEC="specs/a b.r2b.yaml",
        R2BSPEC_OUTPUT="run",
        R2BSPEC_REPORTS="reports",
        R2BSPEC_ARGUMENTS=arguments,
        GITHUB_OUTPUT=str(folder / "output"),
        GITHUB_STEP_SUMMARY=str(folder / "summary"),
        STATUS=str(status),
        OUTCOME=outcome,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(
    ("status", "outcome"), [(0, "pass"), (1, "fail"), (3, "inconclusive"), (4, "invalid")]
)
def test_the_action_tells_how_it_went(folder: Path, status: int, outcome: str) -> None:
    said = run_step(folder, status, outcome)
    assert (folder / "output").read_text() == f"status={status}\noutcome={outcome}\n"
    assert (folder / "summary").read_text() == "### summary\n"
    assert said.startswith("::error file=a.r2b.yaml,line=9::")


def test_arguments_keep_their_spaces(folder: Path) -> None:
    run_step(folder, 0, "pass", "--var=rate=10 Hz\n--set=benchmark.iterations=3\n")
    arguments = (folder / "arguments.txt").read_text().splitlines()
    assert arguments[:4] == ["run", "specs/a b.r2b.yaml", "--output", "run"]
    assert arguments[-2:] == ["--var=rate=10 Hz", "--set=benchmark.iterations=3"]


@pytest.mark.parametrize(
    ("status", "policy", "expected"),
    [("0", "fail", 0), ("1", "pass", 1), ("3", "fail", 3), ("3", "pass", 0), ("", "fail", 4)],
)
def test_the_gate_is_the_exit_status(folder: Path, status: str, policy: str, expected: int) -> None:
    done = bash(folder, STEPS["Gate"]["run"], R2BSPEC_STATUS=status, R2BSPEC_INCONCLUSIVE=policy)
    assert done.returncode == expected


def test_no_input_is_pasted_into_a_script() -> None:
    for step in STEPS.values():
        assert "${{" not in step.get("run", "")


def test_the_options_of_the_pipelines_exist() -> None:
    from r2bspec.cli.run import command
    from r2bspec.report.write_reports import parse_report_requests

    known = {name for option in command.params for name in option.opts}
    template = yaml.safe_load((ROOT / "ci" / "gitlab" / "r2bspec.gitlab-ci.yml").read_text())
    scripts = [STEPS["Run the benchmark"]["run"], *template[".r2bspec"]["script"]]
    for script in scripts:
        words = script.replace("\\\n", " ").split()
        assert {word for word in words if word.startswith("--")} <= known
        asked = [
            words[number + 1].strip('"') for number, word in enumerate(words) if word == "--report"
        ]
        assert asked
        assert len(parse_report_requests(asked)) == len(asked)


def test_the_template_runs_as_a_job(folder: Path) -> None:
    template = yaml.safe_load((ROOT / "ci" / "gitlab" / "r2bspec.gitlab-ci.yml").read_text())
    job = template[".r2bspec"]
    variables = {**job["variables"], "R2BSPEC_SPEC": "a.r2b.yaml", "R2BSPEC_INSTALL": ""}
    done = bash(
        folder,
        "\n".join([*job["before_script"], *job["script"]]),
        **variables,
        STATUS="1",
        OUTCOME="fail",
        ROS_DISTRO="none",
    )
    assert done.returncode == 1, done.stderr
    assert (folder / "r2bspec-reports" / "summary.md").exists()
    assert (folder / "arguments.txt").read_text().startswith("run\na.r2b.yaml\n")
