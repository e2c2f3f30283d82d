"""A repository as colcon has it, with pull requests, and GitHub's program for its API."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from git_repositories import commit, git
from github_runner import Event


@dataclass(frozen=True)
class Upstream:
    """The repository that pull requests are made to, with a branch ``main``."""

    folder: Path

    @classmethod
    def create(cls, folder: Path, files: Mapping[str, str | bytes]) -> Upstream:
        """A repository with one commit; as a service does, it gives any commit that it has."""
        commit(folder, files)
        git(folder, "config", "uploadpack.allowAnySHA1InWant", "true")
        return cls(folder)

    @property
    def main(self) -> str:
        """The commit of ``main``."""
        return git(self.folder, "rev-parse", "main")

    def replace_main(self, files: Mapping[str, str | bytes]) -> None:
        """Commit files to ``main``."""
        commit(self.folder, files)

    def pull_request(
        self, files: Mapping[str, str | bytes], deleted: Sequence[str] = (), number: int = 1
    ) -> Event:
        """A pull request with these files; what a runner checks out is its merge with ``main``."""
        git(self.folder, "switch", "--quiet", "--create", f"change-{number}", "main")
        for path in deleted:
            (self.folder / path).unlink()
        head = commit(self.folder, files)
        git(self.folder, "switch", "--quiet", "--detach", "main")
        git(self.folder, "merge", "--quiet", "--no-ff", "--message", "merge", head)
        git(self.folder, "update-ref", f"refs/pull/{number}/merge", "HEAD")
        git(self.folder, "update-ref", f"refs/pull/{number}/head", head)
        git(self.folder, "switch", "--quiet", "main")
        payload = {
            "pull_request": {
                "number": number,
                "base": {"sha": self.main, "ref": "main"},
                "head": {"sha": head, "repo": {"full_name": "owner/robot"}},
            }
        }
        return Event("pull_request", f"refs/pull/{number}/merge", payload)

    def clone(self, folder: Path, reference: str, *options: str) -> Path:
        """A clone in which a reference is checked out, and no branch is known."""
        git(self.folder, "init", "--quiet", str(folder))
        git(folder, "remote", "add", "origin", self.folder.as_uri())
        git(folder, "fetch", "--quiet", "--no-tags", *options, "origin", reference)
        git(folder, "checkout", "--quiet", "--detach", "FETCH_HEAD")
        return folder


_CURL = '''#!{python} -I
"""Stands for curl and the API of GitHub behind it: the comments of one pull request."""
import json, os, pathlib, sys

place = pathlib.Path({state!r})
state = json.loads(place.read_text())
words = sys.argv[1:]
assert words[0] == "-q", words
options = {{"--request": "", "--header": "", "--data-binary": "", "--output": "", "--max-time": ""}}
url = words[-1]
for number, word in enumerate(words[:-1]):
    if word in options:
        options[word] = words[number + 1]
header = pathlib.Path(options["--header"].removeprefix("@")).read_text()
call = {{"words": words, "method": options["--request"], "url": url, "header": header}}
if options["--data-binary"]:
    call["body"] = json.loads(pathlib.Path(options["--data-binary"].removeprefix("@")).read_text())
state["calls"].append(call)
status = 0
if call["method"] in state["fails"]:
    print("curl: (22) The requested URL returned error: 403", file=sys.stderr)
    status = 22
elif call["method"] == "GET":
    page = int(url.rpartition("page=")[2])
    print(json.dumps(state["comments"][100 * (page - 1) : 100 * page]))
elif call["method"] == "POST":
    state["comments"].append(
        {{
            "id": 1000 + len(state["comments"]),
            "body": call["body"]["body"],
            "user": {{"type": "Bot"}},
            "author_association": "NONE",
        }}
    )
else:
    number = int(url.rpartition("/")[2])
    (comment,) = [one for one in state["comments"] if one["id"] == number]
    comment["body"] = call["body"]["body"]
place.write_text(json.dumps(state))
sys.exit(status)
'''


@dataclass(frozen=True)
class CommentService:
    """A program ``curl`` in a folder for PATH, which keeps the comments of a pull request."""

    folder: Path

    @classmethod
    def create(
        cls, folder: Path, comments: Sequence[Mapping[str, Any]] = (), fails: Sequence[str] = ()
    ) -> CommentService:
        """A service with these comments; requests of the methods in `fails` fail."""
        folder.mkdir()
        service = cls(folder)
        state = {"comments": list(comments), "calls": [], "fails": list(fails)}
        service._state.write_text(json.dumps(state))
        program = folder / "curl"
        program.write_text(_CURL.format(python=sys.executable, state=str(service._state)))
        program.chmod(0o755)
        return service

    @property
    def _state(self) -> Path:
        return self.folder / "state.json"

    @property
    def comments(self) -> list[dict[str, Any]]:
        """What the pull request shows."""
        comments: list[dict[str, Any]] = json.loads(self._state.read_text())["comments"]
        return comments

    @property
    def calls(self) -> list[dict[str, Any]]:
        """Every request."""
        calls: list[dict[str, Any]] = json.loads(self._state.read_text())["calls"]
        return calls
