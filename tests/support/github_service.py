"""A repository on a service, with pull requests as the service makes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from git_repositories import commit, git
from github_runner import Event, pull_request_of


@dataclass(frozen=True)
class Upstream:
    """The repository that pull requests are made to, with a branch ``main``."""

    folder: Path

    @classmethod
    def create(cls, folder: Path, files: Mapping[str, str | bytes]) -> Upstream:
        """A repository with one commit."""
        commit(folder, files)
        return cls(folder)

    @property
    def main(self) -> str:
        """The commit of ``main``."""
        return git(self.folder, "rev-parse", "main")

    def replace_main(self, files: Mapping[str, str | bytes]) -> None:
        """Commit files to ``main``."""
        commit(self.folder, files)

    def pull_request(self, files: Mapping[str, str | bytes], deleted: Sequence[str] = ()) -> Event:
        """A pull request with these files; what a runner checks out is its merge with ``main``."""
        git(self.folder, "switch", "--quiet", "--create", "change", "main")
        for path in deleted:
            (self.folder / path).unlink()
        head = commit(self.folder, files)
        git(self.folder, "switch", "--quiet", "--detach", "main")
        git(self.folder, "merge", "--quiet", "--no-ff", "--message", "merge", head)
        git(self.folder, "update-ref", "refs/pull/1/head", head)
        event = pull_request_of(self.folder, self.main, head, "HEAD")
        git(self.folder, "switch", "--quiet", "main")
        return event

    def clone(self, folder: Path, reference: str, *options: str) -> Path:
        """A clone in which a reference is checked out, and no branch is known."""
        git(self.folder, "init", "--quiet", str(folder))
        git(folder, "remote", "add", "origin", self.folder.as_uri())
        git(folder, "fetch", "--quiet", "--no-tags", *options, "origin", reference)
        git(folder, "checkout", "--quiet", "--detach", "FETCH_HEAD")
        return folder
