"""Changes that go through the recipes of docs/ci.md, as each service runs them."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from git_repositories import git
from github_runner import Event, Job, Runner
from github_service import Upstream
from page_blocks import ROOT, page_file
from pipelines import Workplace

WORKFLOW = page_file("ci.md", ".github/workflows/benchmark.yml")
GATE = ROOT / "ci/shell/gate.sh"
_JENKINSFILE = (ROOT / "ci/jenkins/Jenkinsfile").read_text()


@dataclass(frozen=True)
class Hosts:
    """Runs a pull request by each of the recipes, with a program in place of r2bspec or with it."""

    folder: Path
    upstream: Upstream
    python: str

    def github(
        self,
        change: Event,
        *,
        inputs: Mapping[str, str] | None = None,
        variables: Mapping[str, str] | None = None,
        workflow: str = WORKFLOW,
        environment: Mapping[str, str] | None = None,
        **more: str,
    ) -> tuple[Job, Runner]:
        runner = Runner(
            self.folder / "runner",
            self.upstream.folder.as_uri(),
            {"python": self.python, **(inputs or {})},
            {**(environment or {}), **more},
        )
        return runner.run(workflow, change, variables), runner

    def checkout(self, change: Event, *options: str) -> Path:
        return self.upstream.clone(self.folder / "checkout", change.ref, *options)

    def recipe(
        self,
        name: str,
        change: Event,
        *,
        allow: str = "",
        inconclusive: str = "",
        spec: str = "bench",
        **environment: str,
    ) -> tuple[int, str, list[str]]:
        """Run a pull request; the exit status, what was printed, and the arguments of r2bspec."""
        values = {"R2BSPEC_ALLOW": allow, "STATUS": "0", **environment}
        if inconclusive:
            values["R2BSPEC_INCONCLUSIVE"] = inconclusive
        if name == "github":
            inputs = {
                "allow": allow,
                "inconclusive": inconclusive or "fail",
                "spec": spec,
            }
            job, runner = self.github(change, inputs=inputs, environment=values)
            # The job fails if the step fails, whatever its status.
            code = int(job.outputs["gate"]["status"]) if job.failed else 0
            return code, job.printed, given_arguments(runner.checkout)
        checkout = self.checkout(change)
        runner_folder = self.folder / "runner"
        runner_folder.mkdir(parents=True)
        place = Workplace(checkout, runner_folder)
        base = change.payload["pull_request"]["base"]["sha"]
        if name == "gitlab":
            variables = {"CI_MERGE_REQUEST_DIFF_BASE_SHA": base, **values}
            done = place.job(self.python, spec, "sh", **variables)
            return done.code, done.printed, given_arguments(checkout)
        if name == "jenkins":
            variables = {
                **jenkins_environment(),
                "R2BSPEC_PYTHON": self.python,
                "CHANGE_TARGET": "main",
                "R2BSPEC_SPEC": spec,
                **values,
            }
            code, printed = place.shell("sh", jenkins_script(), **variables)
            return code, printed, given_arguments(checkout)
        git(checkout, "fetch", "--quiet", "origin", "main:refs/remotes/origin/main")
        code, printed = place.shell(
            "sh", shlex.join(["sh", str(GATE), spec]), R2BSPEC_PYTHON=self.python, **values
        )
        return code, printed, given_arguments(checkout)


def given_arguments(checkout: Path) -> list[str]:
    """What the stand-in was called with."""
    kept = checkout / "arguments.txt"
    return kept.read_text().splitlines() if kept.exists() else []


def jenkins_script() -> str:
    """The only `sh` step of the Jenkinsfile, as Groovy reads it: it has no escapes."""
    (script,) = re.findall(r"sh '''(.*?)'''", _JENKINSFILE, re.DOTALL)
    assert "\\" not in script
    return str(script)


def jenkins_environment() -> dict[str, str]:
    (block,) = re.findall(r"environment \{(.*?)\n  \}", _JENKINSFILE, re.DOTALL)
    return dict(re.findall(r"^\s+(\w+) = '(.*?)'", block, re.MULTILINE))
