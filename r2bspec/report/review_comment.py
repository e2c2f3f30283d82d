"""One comment on the pull request that is gated, which the next runs of the same job update.

The recipes of GitHub and GitLab call this once the verdict is known, with the interpreter that has
r2bspec::

    python -I -m r2bspec.report.review_comment github|gitlab FOLDER STATUS

FOLDER has ``reports/summary.md``, and STATUS is that of ``r2bspec run``. Everything else is in the
variables that the service gives to a job, and in ``R2BSPEC_TOKEN``, ``R2BSPEC_SPEC`` and
``R2BSPEC_ARGUMENTS``. A comment that cannot be written is a warning, and the exit status is 0: no
answer of a service decides a verdict.

The comment is found by its first line, which is hidden, and only if the token's own user (GitLab),
a bot or a member (GitHub) wrote it: what a stranger wrote is never taken for it.
"""

from __future__ import annotations

import hashlib
import http.client
import json
import os
import re
import sys
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.report.output import echo
from r2bspec.safe_io import safe_file
from r2bspec.safe_io.limits import MAX_ANSWER_BYTES, MAX_SUMMARY_BYTES
from r2bspec.safe_io.safe_json import decode_json

_FREE: Final = frozenset({"id"})
_PER_PAGE: Final = 100
_MAX_PAGES: Final = 30
_TIMEOUT_S: Final = 60
_COMMAND = re.compile(r"^( {0,3})/(?=\w)", re.MULTILINE)
"""What GitLab carries out, such as ``/merge``, if it is the first word of a line of a note."""


class _Author(msgspec.Struct, frozen=True):
    id: int
    type: str = ""


class _Comment(msgspec.Struct, frozen=True):
    """What both services answer of a comment; GitLab calls its user author."""

    id: int
    body: str | None = None
    user: _Author | None = None
    author: _Author | None = None
    author_association: str = ""


@dataclass(frozen=True)
class _Service:
    """How one service is asked.

    Attributes:
        headers: with the token.
        comments: the address at which comments are listed and created.
        comment: the address below which each comment has its number.
        update: the method that replaces a comment.
        max_bytes: of a comment. Services count characters, which are never more.
        title: of the job, which no other job on the same change has.
        log: the address of the log.
        is_own: whether a comment may be replaced.
    """

    headers: Mapping[str, str]
    comments: str
    comment: str
    update: str
    max_bytes: int
    title: tuple[str, ...]
    log: str
    is_own: Callable[[_Comment], bool]


def _github(variables: Mapping[str, str]) -> _Service:
    repository = f"{variables['GITHUB_API_URL']}/repos/{variables['GITHUB_REPOSITORY']}"
    run = f"{variables['GITHUB_REPOSITORY']}/actions/runs/{variables['GITHUB_RUN_ID']}"
    members = {"OWNER", "MEMBER", "COLLABORATOR"}
    return _Service(
        headers={
            "Authorization": f"Bearer {variables['R2BSPEC_TOKEN'].strip()}",
            "Accept": "application/vnd.github+json",
            "X-GitHub-Api-Version": "2022-11-28",
        },
        comments=f"{repository}/issues/{variables['R2BSPEC_PULL_REQUEST']}/comments",
        comment=f"{repository}/issues/comments",
        update="PATCH",
        max_bytes=65_000,
        title=(variables["GITHUB_WORKFLOW"], variables["GITHUB_JOB"]),
        log=f"{variables['GITHUB_SERVER_URL']}/{run}",
        is_own=lambda comment: (
            comment.author_association in members
            or (comment.user is not None and comment.user.type == "Bot")
        ),
    )


def _gitlab(variables: Mapping[str, str]) -> _Service:
    api = variables["CI_API_V4_URL"]
    # The number of a merge request is that of the project it is made to, which a fork is not.
    project = variables.get("CI_MERGE_REQUEST_PROJECT_ID") or variables["CI_PROJECT_ID"]
    request = variables["CI_MERGE_REQUEST_IID"]
    notes = f"{api}/projects/{project}/merge_requests/{request}/notes"
    headers = {"PRIVATE-TOKEN": variables["R2BSPEC_TOKEN"].strip()}
    user = decode_json(_send(headers, "GET", f"{api}/user"), _Author, free=_FREE)
    return _Service(
        headers=headers,
        comments=notes,
        comment=notes,
        update="PUT",
        max_bytes=1_000_000,
        title=(variables["CI_JOB_NAME"],),
        log=variables["CI_JOB_URL"],
        is_own=lambda comment: comment.author is not None and comment.author.id == user.id,
    )


_SERVICES: Final = {"github": _github, "gitlab": _gitlab}


def post(service: _Service, marker: str, text: str) -> None:
    """Replace the comment that begins with the marker; make it if there is none.

    Raises:
        OSError: the service cannot be reached, or refuses.
        ValueError, msgspec.DecodeError, http.client.HTTPException: its answer is not readable.
    """
    body = json.dumps({"body": text}).encode()
    for page in range(1, _MAX_PAGES + 1):
        url = f"{service.comments}?per_page={_PER_PAGE}&page={page}"
        comments = decode_json(_send(service.headers, "GET", url), list[_Comment], free=_FREE)
        for comment in comments:
            if (comment.body or "").startswith(marker) and service.is_own(comment):
                _send(service.headers, service.update, f"{service.comment}/{comment.id}", body)
                return
        if len(comments) < _PER_PAGE:
            break
    _send(service.headers, "POST", service.comments, body)


def _send(headers: Mapping[str, str], method: str, url: str, body: bytes | None = None) -> bytes:
    if not url.startswith(("https://", "http://")):
        raise ValueError(url)
    request = urllib.request.Request(url, data=body, method=method)  # noqa: S310 - see above
    if body is not None:
        request.add_header("Content-Type", "application/json")
    for name, value in headers.items():
        # Unlike other headers, not sent to where a service redirects to: one is the token.
        request.add_unredirected_header(name, value)
    with urllib.request.urlopen(request, timeout=_TIMEOUT_S) as answer:  # noqa: S310
        content: bytes = answer.read(MAX_ANSWER_BYTES)
    return content


def comment_text(marker: str, summary: str, log: str, max_bytes: int) -> str:
    """The comment: the summary whole, or as many of its lines as fit, and where the log is."""
    harmless = _COMMAND.sub(r"\1\\/", summary.replace("\0", "\ufffd"))
    whole = f"{marker}\n{harmless}\n\n[The log]({log})\n"
    if len(whole.encode()) <= max_bytes:
        return whole
    # First, because the end may be inside of something that is folded.
    start = f"{marker}\nThis report is clipped; [the job]({log}) has all of it.\n\n"
    kept = harmless.encode()[: max_bytes - len(start.encode())].rpartition(b"\n")[0]
    return start + kept.decode(errors="ignore")


def _summary(folder: Path, status: str) -> str:
    try:
        content = safe_file.read_bytes(
            folder / "reports" / "summary.md", max_bytes=MAX_SUMMARY_BYTES, folders=[folder]
        )
    except (OSError, R2bspecError):
        return f"r2bspec ended with status {status} and without a result."
    return content.decode(errors="replace")


def _marker(service: _Service, variables: Mapping[str, str]) -> str:
    """The first line of the comment: each job, spec and list of arguments has its own."""
    parts = (*service.title, variables["R2BSPEC_SPEC"], variables["R2BSPEC_ARGUMENTS"])
    digest = hashlib.sha256("\n".join(parts).encode(errors="surrogateescape"))
    return f"<!-- r2bspec {digest.hexdigest()[:16]} -->"


def _reason(error: Exception) -> str:
    """Why there is no comment, without what the text of an error may quote, such as the token."""
    if isinstance(error, urllib.error.HTTPError):
        return f"the service answered with status {error.code}"
    if isinstance(error, KeyError):
        return f"the variable {error.args[0]} is not set"
    if isinstance(error, OSError):
        return "the service cannot be reached"
    return "the answer of the service is not readable"


def main(arguments: list[str]) -> int:
    """Write the comment, or print a warning."""
    name, folder, status = arguments
    variables = os.environ
    try:
        service = _SERVICES[name](variables)
        marker = _marker(service, variables)
        summary = _summary(Path(folder), status)
        post(service, marker, comment_text(marker, summary, service.log, service.max_bytes))
    except (OSError, ValueError, KeyError, msgspec.DecodeError, http.client.HTTPException) as error:
        is_command = name == "github"
        start = "::warning title=r2bspec::" if is_command else "Warning: "
        echo(
            f"{start}The comment could not be written: {_reason(error)}. "
            "It has no effect on the verdict.",
            commands=is_command,
        )
    return ExitStatus.OK


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
