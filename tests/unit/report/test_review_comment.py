"""Promise: a change shows the report in one comment, which decides no verdict and leaks no token.

The scripts of the recipes run as they are; the service is a small HTTP server, which records.
"""

from __future__ import annotations

import re
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from github_runner import Event
from github_service import Upstream
from pipelines import stand_in
from r2bspec.report.review_comment import comment_text
from recipe_hosts import WORKFLOW, Hosts
from review_services import OWN_ID, ReviewService, review_service

TOKEN = "glpat-of-the-project"
WARNING = "The comment could not be written"


@dataclass(frozen=True)
class Reviewed:
    """Runs a change by one of the recipes that comment; the comments go to a service."""

    name: str
    hosts: Hosts
    change: Event

    def run(
        self,
        service: ReviewService,
        token: str = TOKEN,
        job: str = "benchmark",
        **environment: str,
    ) -> tuple[int, str]:
        """The exit status of the job, and what it printed."""
        hosts = replace(self.hosts, folder=Path(tempfile.mkdtemp(dir=self.hosts.folder)))
        if self.name == "github":
            ran, _ = hosts.github(
                self.change,
                workflow=WORKFLOW.replace("  benchmark:\n", f"  {job}:\n"),
                inputs={"token": token},
                environment={"STATUS": "0", "GITHUB_API_URL": service.url, **environment},
            )
            assert len(ran.summary.encode()) <= 1 << 20
            return (int(ran.outputs["gate"]["status"]) if ran.failed else 0), ran.printed
        variables = {
            "CI_API_V4_URL": service.url,
            "CI_PROJECT_ID": "5",
            "CI_MERGE_REQUEST_IID": "7",
            "CI_JOB_NAME": job,
            "CI_JOB_URL": "https://gitlab.example/job/1",
            "GITLAB_TOKEN": token,
        }
        code, printed, _ = hosts.recipe("gitlab", self.change, **{**variables, **environment})
        return code, printed

    @property
    def update(self) -> str:
        """The method that replaces a comment."""
        return "PATCH" if self.name == "github" else "PUT"


@pytest.fixture(name="reviewed", params=["github", "gitlab"])
def changed_repository(tmp_path: Path, request: pytest.FixtureRequest) -> Reviewed:
    upstream = Upstream.create(tmp_path / "upstream", {"bench/blur.r2b.yaml": "r2bspec: 1\n"})
    change = upstream.pull_request({"node.py": "# another\n"})
    return Reviewed(request.param, Hosts(tmp_path, upstream, str(stand_in(tmp_path))), change)


def strangers_comment(number: int, body: str | None) -> dict[str, object]:
    return {
        "id": number,
        "body": body,
        "user": {"id": 3, "type": "User"} if number % 2 else None,
        "author": {"id": 3, "username": "stranger"},
        "author_association": "CONTRIBUTOR",
    }


def test_the_comment_is_made_and_then_updated(reviewed: Reviewed) -> None:
    others = [strangers_comment(number, "more" if number else None) for number in range(122)]
    with review_service(others) as service:
        assert reviewed.run(service, STATUS="1")[0] == 1
        assert service.methods == ["GET", "GET", "POST"]
        assert re.match(r"<!-- r2bspec \w{16} -->\n### summary\n", service.comments[-1]["body"])
        reviewed.run(service, NO_RESULT="1", STATUS="0")
        assert service.methods[3:] == ["GET", "GET", reviewed.update]
    assert len(service.comments) == len(others) + 1
    header = "Authorization" if reviewed.name == "github" else "Private-Token"
    assert TOKEN in service.requests[-1].headers[header]


def test_another_job_has_a_comment_of_its_own(reviewed: Reviewed) -> None:
    with review_service() as service:
        reviewed.run(service)
        reviewed.run(service, job="other")
    assert service.methods == ["GET", "POST"] * 2


def test_a_strangers_comment_is_never_taken_for_its_own(reviewed: Reviewed) -> None:
    with review_service() as service:
        reviewed.run(service)
    (own,) = service.comments
    with review_service([strangers_comment(7, own["body"])]) as again:
        reviewed.run(again)
    assert len(again.comments) == 2
    assert again.comments[0]["body"] == own["body"]


@pytest.mark.parametrize(("refused", "status"), [("GET", "1"), ("POST", "0")])
def test_a_refused_token_is_a_warning_and_no_verdict(
    reviewed: Reviewed, refused: str, status: str
) -> None:
    with review_service(refused=[refused]) as service:
        code, printed = reviewed.run(service, STATUS=status)
    assert code == int(status)
    assert f"{WARNING}: the service answered with status 403" in printed
    assert TOKEN not in printed
    assert service.comments == []


def test_a_service_that_is_away_is_a_warning_and_no_verdict(reviewed: Reviewed) -> None:
    with review_service() as service:
        pass
    code, printed = reviewed.run(service)
    assert code == 0
    assert f"{WARNING}: the service cannot be reached" in printed


def test_a_token_that_no_header_can_have_is_not_printed(reviewed: Reviewed) -> None:
    with review_service() as service:
        code, printed = reviewed.run(service, token=f"{TOKEN}\n{TOKEN}")
    assert code == 0
    assert WARNING in printed
    assert TOKEN not in printed


def test_nobody_comments_without_a_token(reviewed: Reviewed) -> None:
    """As in a pipeline of a fork, which has no secrets."""
    with review_service() as service:
        code, printed = reviewed.run(service, token="")
    assert code == 0
    assert WARNING not in printed
    assert service.requests == []


def test_what_the_benchmark_starts_has_no_token(reviewed: Reviewed) -> None:
    with review_service() as service:
        reviewed.run(service)
    (environment,) = reviewed.hosts.folder.rglob("environment.txt")
    assert TOKEN not in environment.read_text()
    assert len(service.comments) == 1


def test_a_report_of_more_than_a_mebibyte_is_clipped(reviewed: Reviewed, tmp_path: Path) -> None:
    line = f"| {'é' * 500} |\n"
    summary = tmp_path / "summary.md"
    summary.write_text(line * 2500)
    with review_service() as service:
        code, printed = reviewed.run(service, SUMMARY=str(summary))
        assert code == 0
        assert WARNING not in printed
        reviewed.run(service, SUMMARY=str(summary))
    (comment,) = service.comments
    _, notice, _, *lines = comment["body"].splitlines()
    assert notice.startswith("This report is clipped; [the job](https://")
    assert len(lines) > 50
    assert set(lines) == {line.rstrip("\n")}


def test_no_line_of_a_report_is_a_command_of_the_service() -> None:
    """GitLab carries out lines of a note that begin with a slash."""
    text = comment_text("<!-- m -->", "a /b\n/merge\n  /close\n    /opt/ros\n", "https://l", 1000)
    assert text.splitlines()[1:5] == ["a /b", "\\/merge", "  \\/close", "    /opt/ros"]


def test_a_clipped_text_is_within_the_limit() -> None:
    for limit in range(100, 130):
        text = comment_text("<!-- m -->", "äö\n" * 100, "https://l", limit)
        assert len(text.encode()) <= limit
        assert "\ufffd" not in text


def test_the_number_of_a_merge_request_is_that_of_its_project(tmp_path: Path) -> None:
    upstream = Upstream.create(tmp_path / "upstream", {"a": ""})
    hosts = Hosts(tmp_path, upstream, str(stand_in(tmp_path)))
    reviewed = Reviewed("gitlab", hosts, upstream.pull_request({"a": "1"}))
    with review_service() as service:
        reviewed.run(service, CI_PROJECT_ID="99", CI_MERGE_REQUEST_PROJECT_ID="5")
    assert service.comments[0]["author"]["id"] == OWN_ID
