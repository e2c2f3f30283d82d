"""Git, which reads a repository and executes nothing that the repository names.

The configuration of a repository can name programs: hooks, a file system monitor, filters of
files, helpers of transports, a pager. A work tree that is only looked at must start none of them.
`run_git` therefore names the repository and its work tree itself, so that git looks for no other
one; drops what the environment says about them; overrides what would start a program; and allows
no transport, so that a repository with missing objects fetches none. Submodules are repositories
of their own, with configurations of their own, and are never entered.

Filters have names of the user's choice. `inspect_work_tree`, which compares files with commits and
would have them filtered, asks for the names first and overrides each.
"""

from __future__ import annotations

import os
import re
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from r2bspec.safe_io.limits import MAX_GIT_REFS

GIT_TIMEOUT_S: Final = 60.0

_KEPT_VARIABLES: Final = frozenset(
    {"GIT_EXEC_PATH", "GIT_CONFIG_GLOBAL", "GIT_CONFIG_SYSTEM", "GIT_CONFIG_NOSYSTEM"}
)
"""Where git and the configuration of the user are; every other variable of git is dropped."""

_VARIABLES: Final = {
    "GIT_ALLOW_PROTOCOL": "none",
    "GIT_GRAFT_FILE": os.devnull,
    "GIT_LITERAL_PATHSPECS": "1",
    "GIT_NO_LAZY_FETCH": "1",
    "GIT_NO_REPLACE_OBJECTS": "1",
    "GIT_OPTIONAL_LOCKS": "0",
    "GIT_TERMINAL_PROMPT": "0",
}

_OVERRIDES: Final = (
    "core.fsmonitor=false",
    f"core.hooksPath={os.devnull}",
    "core.sshCommand=false",
    "credential.helper=",
    "diff.ignoreSubmodules=all",
    "submodule.recurse=false",
)

_FILTER_KEYS: Final = (("clean", ""), ("smudge", ""), ("process", ""), ("required", "false"))


@dataclass(frozen=True, slots=True)
class WorkTreeState:
    """The state of a work tree as git reports it.

    Attributes:
        commit: the full name of the commit that is checked out; empty before the first commit.
        changed: the paths of tracked files that differ from it, below the top, sorted.
    """

    commit: str
    changed: tuple[str, ...]


def find_work_tree(folder: Path) -> Path | None:
    """Return the top of the innermost work tree that contains a folder; None outside of one."""
    try:
        start = folder.resolve()
        return next((path for path in (start, *start.parents) if (path / ".git").exists()), None)
    except (OSError, RuntimeError, ValueError):
        return None


def git_command(top: Path, *arguments: str) -> list[str]:
    """Return the command line of git for a work tree, to be run with `git_environment`.

    With its folders named, git looks for no repository, and so finds none that a stranger put
    below the work tree.

    Args:
        top: the top of the work tree, which has ``.git``: a folder, or the file of a linked tree.
        arguments: the subcommand and what follows it.
    """
    options = [f"--git-dir={top / '.git'}", f"--work-tree={top}", "--no-pager"]
    for override in _OVERRIDES:
        options += ["-c", override]
    return ["git", *options, *arguments]


def git_environment(filters: Iterable[str] = ()) -> dict[str, str]:
    """Return the environment of git.

    Args:
        filters: the names of filters that are to do nothing.
    """
    environment = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith("GIT_") or name in _KEPT_VARIABLES
    }
    environment |= _VARIABLES
    # Not by `-c`, which ends the name of a key at its first equals sign.
    settings = [(f"filter.{name}.{key}", value) for name in filters for key, value in _FILTER_KEYS]
    if settings:
        environment["GIT_CONFIG_COUNT"] = str(len(settings))
        for number, (key, value) in enumerate(settings):
            environment[f"GIT_CONFIG_KEY_{number}"] = key
            environment[f"GIT_CONFIG_VALUE_{number}"] = value
    return environment


def run_git(
    top: Path,
    *arguments: str,
    filters: Iterable[str] = (),
) -> subprocess.CompletedProcess[bytes] | None:
    """Run git on a work tree; None if there is no git, or it does not end in time.

    A configuration can include a pipe, to which nobody writes: git is not asked a second time then.

    Args:
        top: the top of the work tree.
        arguments: the subcommand and what follows it. One that reads or writes files of the work
            tree needs `filters`.
        filters: the names of filters that are to do nothing (`filter_names`).
    """
    if top in _SILENT:
        return None
    try:
        return subprocess.run(
            git_command(top, *arguments),
            env=git_environment(filters),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=GIT_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        _SILENT.add(top)
    except (OSError, ValueError):
        pass
    return None


_SILENT: Final[set[Path]] = set()
"""The work trees of which git did not answer in time."""


def output_of(top: Path, *arguments: str) -> str:
    """Return what git prints about a work tree, without the last line break; empty if it fails."""
    return (_output(top, *arguments) or "").strip()


def _output(top: Path, *arguments: str, filters: Iterable[str] = ()) -> str | None:
    """Return what git prints about a work tree; None if it fails."""
    done = run_git(top, *arguments, filters=filters)
    if done is None or done.returncode:
        return None
    return done.stdout.decode(errors="surrogateescape")


def filter_names(top: Path) -> frozenset[str] | None:
    """Return the filters that the configurations of the repository and the user name.

    None if unknown.
    """
    done = run_git(top, "config", "--null", "--name-only", "--get-regexp", r"^filter\.")
    # An exit status of 1 says that no key matches.
    if done is None or done.returncode not in {0, 1}:
        return None
    keys = done.stdout.decode(errors="surrogateescape").split("\0")
    return frozenset(key.removeprefix("filter.").rpartition(".")[0] for key in keys if key)


def inspect_work_tree(top: Path) -> WorkTreeState | None:
    """Return the commit and the changed files of a work tree; None if git cannot tell.

    Files that git does not track, and submodules, are not looked at. Filters do nothing: a file
    that is stored filtered, and that git cannot tell to be unchanged by its times, counts as
    changed.
    """
    filters = filter_names(top)
    if filters is None:
        return None
    entries = _output(
        top,
        "status",
        *("--porcelain=v2", "--branch", "-z", "--no-ahead-behind", "--no-renames"),
        *("--untracked-files=no", "--ignore-submodules=all"),
        filters=filters,
    )
    if entries is None:
        return None
    commit, changed = "", set[str]()
    for entry in entries.split("\0"):
        kind, _, rest = entry.partition(" ")
        if kind == "#":
            key, _, value = rest.partition(" ")
            commit = value if key == "branch.oid" and value != "(initial)" else commit
        elif kind in _PATH_FIELDS:
            changed.add(rest.split(" ", _PATH_FIELDS[kind])[-1])
    return WorkTreeState(commit, tuple(sorted(changed)))


_PATH_FIELDS: Final = {"1": 7, "u": 9}
"""How many fields of an entry come before its path: of changed files, and of unmerged ones."""


def ref_names(top: Path) -> tuple[str, ...]:
    """Return the branches, branches of remotes, and tags of a repository.

    None if git cannot tell.
    """
    options = (f"--count={MAX_GIT_REFS}", "--format=%(refname:short)")
    names = _output(top, "for-each-ref", *options, "refs/remotes", "refs/heads", "refs/tags")
    return tuple((names or "").split())


def commits_named(top: Path, revision: str) -> dict[str, str]:
    """Return the commits that a revision may mean, by the full names that lead to them.

    Git takes the first that exists: a reference before the beginning of a commit's name, and a tag
    before a branch before a branch of a remote before the main branch of a remote.
    """
    match = _REVISION.fullmatch(revision)
    if match is None:
        return {}
    name, steps = match["name"], match["steps"]
    names = [name]
    if not name.startswith("refs/"):
        names += [f"refs/{kind}{name}" for kind in ("remotes/", "heads/", "tags/", "")]
        names.append(f"refs/remotes/{name}/HEAD")
    if digits := _ABBREVIATED.search(name):
        names += output_of(top, "rev-parse", f"--disambiguate={digits[1]}").split()
    commits = {full: commit_of(top, f"{full}{steps}") for full in names}
    return {full: commit for full, commit in commits.items() if commit is not None}


_REVISION: Final = re.compile(r"(?P<name>[^~^]*)(?P<steps>.*)", re.DOTALL)
"""A name, and steps from the commit that it has: ``main~2``."""

_ABBREVIATED: Final = re.compile(r"(?:^|-g)([0-9a-f]{4,39})$")
"""The beginning of a commit's name, also as ``git describe`` prints it."""


def object_of(top: Path, path: str) -> str:
    """Return the object that git would make of a file of the work tree; empty if it cannot.

    Filters are not applied: a file that is stored filtered has another object.
    """
    return output_of(top, "hash-object", "--no-filters", "--", str(top / path))


def commit_of(top: Path, revision: str) -> str | None:
    """Return the full name of the commit that a revision means.

    None if git knows no such commit.
    """
    commit = _output(top, "rev-parse", "--verify", "--end-of-options", f"{revision}^{{commit}}")
    return None if commit is None else commit.strip()
