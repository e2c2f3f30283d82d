"""Pull requests that go through the recipes of docs/ci.md, as each service runs them."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from git_repositories import clone, commit, git
from page_blocks import ROOT
from pipelines import Workplace

GATE = ROOT / "ci/shell/gate.sh"
_JENKINSFILE = (ROOT / "ci/jenkins/Jenkinsfile").read_text()
MERGED = "refs/pull/1/merge"
"""What a service checks out of a pull request: its merge with the base."""


@dataclass(frozen=True)
class Upstream:
    """The repository that pull requests are made to, with a branch ``main``."""

    folder: Path

    @property
    def main(self) -> str:
        """The commit of ``main``."""
        return git(self.folder, "rev-parse", "main")

    def pull_request(self, files: Mapping[str, str | bytes], deleted: Sequence[str] = ()) -> None:
        """Make the pull request 1 of these files."""
        git(self.folder, "switch", "--quiet", "--create", "change", "main")
        for path in deleted:
            (self.folder / path).unlink()
        head = commit(self.folder, files)
        git(self.folder, "switch", "--quiet", "--detach", "main")
        git(self.folder, "merge", "--quiet", "--no-ff", "--message", "merge", head)
        publish_merge(self.folder, "HEAD")
        git(self.folder, "switch", "--quiet", "main")


def publish_merge(repository: Path, merge: str) -> None:
    """Offer a commit as the merge of the pull request 1, and every commit to who knows it."""
    git(repository, "update-ref", MERGED, merge)
    git(repository, "config", "uploadpack.allowAnySHA1InWant", "true")


@dataclass(frozen=True)
class Hosts:
    """Runs the pull request by each of the recipes; a program may stand for r2bspec."""

    folder: Path
    upstream: Upstream
    python: str

    def place(self, *options: str) -> Workplace:
        """Check the pull request out for a job."""
        checkout = clone(self.upstream.folder, self.folder / "checkout", MERGED, *options)
        place = Workplace(checkout, self.folder / "runner")
        place.runner.mkdir(parents=True)
        return place

    def recipe(
        self,
        name: str,
        *,
        base: str = "",
        allow: str = "",
        inconclusive: str = "",
        spec: str = "bench",
        **environment: str,
    ) -> tuple[int, str, list[str]]:
        """Run it; return the exit status, what was printed, and the arguments of r2bspec."""
        base = base or self.upstream.main
        values = {"STATUS": "0", **environment}
        if name == "github":
            place = self.place("--depth=1")
            options = {"allow": allow, "inconclusive": inconclusive or "fail"}
            done = place.action(self.python, spec, base, **options, **values)
            return done.code, done.printed, given_arguments(place.checkout)
        values["R2BSPEC_ALLOW"] = allow
        if inconclusive:
            values["R2BSPEC_INCONCLUSIVE"] = inconclusive
        place = self.place()
        if name == "gitlab":
            values["CI_MERGE_REQUEST_DIFF_BASE_SHA"] = base
            done = place.job(self.python, spec, "sh", **values)
            return done.code, done.printed, given_arguments(place.checkout)
        values["R2BSPEC_PYTHON"] = self.python
        if name == "jenkins":
            of_job = {**_jenkins_environment(), "CHANGE_TARGET": "main", "R2BSPEC_SPEC": spec}
            code, printed = place.shell("sh", _jenkins_script(), **{**of_job, **values})
        else:
            git(place.checkout, "fetch", "--quiet", "origin", "main:refs/remotes/origin/main")
            code, printed = place.shell("sh", shlex.join(["sh", str(GATE), spec]), **values)
        return code, printed, given_arguments(place.checkout)


def given_arguments(checkout: Path) -> list[str]:
    """Return what the stand-in was called with."""
    kept = checkout / "arguments.txt"
    return kept.read_text().splitlines() if kept.exists() else []


def _jenkins_script() -> str:
    """Return the only `sh` step of the Jenkinsfile, as Groovy reads it: it has no escapes."""
    (script,) = re.findall(r"sh '''(.*?)'''", _JENKINSFILE, re.DOTALL)
    assert "\\" not in script
    return str(script)


def _jenkins_environment() -> dict[str, str]:
    (block,) = re.findall(r"environment \{(.*?)\n  \}", _JENKINSFILE, re.DOTALL)
    return dict(re.findall(r"^\s+(\w+) = '(.*?)'", block, re.MULTILINE))
