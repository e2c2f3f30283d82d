"""The part of GitHub's and GitLab's API that comments on changes, which records what it is sent."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

OWN_ID = 42
"""The number of the user whom the token belongs to."""

GITHUB_COMMENTS = "/repos/owner/robot/issues/1/comments"
GITLAB_NOTES = "/projects/5/merge_requests/7/notes"

_LIMITS = {GITHUB_COMMENTS: 65_536, GITLAB_NOTES: 1_000_000}
_PLACES = {
    "/repos/owner/robot/issues/comments": GITHUB_COMMENTS,
    GITLAB_NOTES: GITLAB_NOTES,
}
"""The address below which a comment has its number, and the list that it is in."""


@dataclass(frozen=True)
class Request:
    """What was asked."""

    method: str
    path: str
    headers: Mapping[str, str]
    body: str


@dataclass
class ReviewService:
    """The comments of one change.

    Attributes:
        url: of the API.
        comments: as the service lists them, oldest first.
        refused: the methods that it answers with status 403.
        requests: every one.
    """

    url: str
    comments: list[dict[str, Any]]
    refused: Sequence[str]
    requests: list[Request] = field(default_factory=list)

    @property
    def methods(self) -> list[str]:
        """Of every request, but for that of the token's user."""
        return [request.method for request in self.requests if request.path != "/user"]

    def answer(self, request: Request) -> tuple[int, object]:
        """The status and the value that a service answers."""
        self.requests.append(request)
        if request.method in self.refused:
            return 403, {"message": "Forbidden"}
        address = urlsplit(request.path)
        if address.path == "/user":
            return 200, {"id": OWN_ID, "username": "project_5_bot"}
        if request.method == "GET":
            assert address.path in _LIMITS, address.path
            query = parse_qs(address.query)
            size, page = int(query["per_page"][0]), int(query["page"][0])
            return 200, self.comments[size * (page - 1) : size * page]
        body = json.loads(request.body)["body"]
        if request.method == "POST":
            if len(body) > _LIMITS[address.path]:
                return 422, {"message": "body is too long"}
            self.comments.append(_comment(1000 + len(self.comments), body))
            return 201, self.comments[-1]
        place, _, number = address.path.rpartition("/")
        if len(body) > _LIMITS[_PLACES[place]]:
            return 422, {"message": "body is too long"}
        assert request.method == ("PUT" if place == GITLAB_NOTES else "PATCH")
        (comment,) = [one for one in self.comments if one["id"] == int(number)]
        comment["body"] = body
        return 200, comment


def _comment(number: int, body: str) -> dict[str, Any]:
    return {
        "id": number,
        "body": body,
        "user": {"id": OWN_ID, "type": "Bot"},
        "author": {"id": OWN_ID, "username": "project_5_bot"},
        "author_association": "NONE",
    }


@contextmanager
def review_service(
    comments: Sequence[Mapping[str, Any]] = (), refused: Sequence[str] = ()
) -> Iterator[ReviewService]:
    """A service on this machine with these comments."""

    class Handler(BaseHTTPRequestHandler):
        def _answer(self) -> None:
            length = int(self.headers.get("Content-Length", 0))
            body = self.rfile.read(length).decode()
            headers = dict(self.headers.items())
            status, value = service.answer(Request(self.command, self.path, headers, body))
            content = json.dumps(value).encode()
            self.send_response(status)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        do_GET = do_POST = do_PUT = do_PATCH = _answer  # noqa: N815 - names of the base class

        def log_message(self, *_arguments: object) -> None:
            """Print nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    service = ReviewService(
        f"http://127.0.0.1:{server.server_port}", [dict(comment) for comment in comments], refused
    )
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
    thread.start()
    try:
        yield service
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
