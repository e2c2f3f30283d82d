"""The environment variables of a spec that a stranger's version of it may read.

With ``--untrusted``, `environment` may list only what the base version of the same spec lists. All
else is an error at its place, and is not read. The version in the base is read from git without
checking anything out: only the object database of the repository is read. No file of the working
tree can change what is read: neither an attribute nor a filter is applied, and a repository below
the working tree, which could bring a configuration of its own, is never looked at.
"""

from __future__ import annotations

import itertools
import posixpath
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from r2bspec.diagnostics import Diagnostic
from r2bspec.diagnostics.quote import clip
from r2bspec.errors import UsageError
from r2bspec.language.document import decode
from r2bspec.language.extends import KEY, extended_names
from r2bspec.language.located_tree import MapNode, TreeNode
from r2bspec.language.variables import listed_environment
from r2bspec.language.yaml_document import compose
from r2bspec.safe_io.limits import MAX_DOCUMENT_BYTES, MAX_EXTENDED_FILES, MAX_EXTENDS_DEPTH


class BaseVersionError(UsageError):
    """The base of a change that cannot be read."""

    code = "R2B667"


@dataclass(frozen=True, slots=True)
class BaseVersion:
    """One commit of a repository.

    Attributes:
        top: the folder of the working tree.
        commit: the full name of the commit.
    """

    top: Path
    commit: str

    def environment_names(self, file: str) -> frozenset[str]:
        """The variables that the base version of a spec lists; none if the base has no such spec.

        What the base version extends is read from the base, too.
        """
        try:
            inside = Path(file).resolve().relative_to(self.top)
        except (OSError, ValueError, RuntimeError):
            return frozenset()
        return _environment_names(self, inside.as_posix())

    def read(self, path: str) -> bytes | None:
        """The content of a file, by its path below `top`; None if the commit has no such file."""
        from r2bspec.safe_io.git import run_git

        done = run_git(self.top, "cat-file", "blob", f"{self.commit}:{path}")
        text = done.stdout if done is not None and done.returncode == 0 else None
        return None if text is None or len(text) > MAX_DOCUMENT_BYTES else text


def base_version(reference: str, folder: Path) -> BaseVersion:
    """The commit that a branch, a tag or the name of a commit means.

    Args:
        reference: what git calls it, such as ``origin/main``.
        folder: a folder of the working tree.

    Raises:
        BaseVersionError: there is no such commit, no repository, or no git.
    """
    # Most specs are not a stranger's, and what starts processes takes long to import.
    from r2bspec.safe_io.git import find_work_tree, run_git

    top = find_work_tree(folder)
    if top is None:
        raise BaseVersionError(
            f"{folder} is not in a git repository, so --base-ref cannot be read",
            hint="Run it in the repository of the specs, or leave --base-ref out.",
        )
    done = run_git(top, "rev-parse", "--verify", "--end-of-options", f"{reference}^{{commit}}")
    if done is None:
        raise BaseVersionError(
            "git cannot be executed, so --base-ref cannot be read",
            hint="Install git, or leave --base-ref out.",
        )
    if done.returncode:
        raise BaseVersionError(
            f"git knows no commit {reference!r}",
            hint="Fetch it first: git fetch --depth=1 origin COMMIT.",
        )
    return BaseVersion(top, done.stdout.decode().strip())


@lru_cache(maxsize=1024)
def _environment_names(base: BaseVersion, path: str) -> frozenset[str]:
    """The names in a file of the base and in what that extends, once for all cases of a spec."""
    files = itertools.count(1)

    def names(path: str, depth: int) -> frozenset[str] | None:
        """The names; None if neither the file nor what it extends says anything."""
        if depth > MAX_EXTENDS_DEPTH or next(files) > MAX_EXTENDED_FILES:
            return None
        data = base.read(path)
        tree = compose(decode(data, path)).tree if data is not None else None
        if not isinstance(tree, MapNode):
            return None
        if "environment" in tree.entries:
            return frozenset(listed_environment(tree))
        variables: frozenset[str] | None = None
        for extended_name in extended_names(tree) if KEY in tree.entries else ():
            target = posixpath.normpath(
                posixpath.join(posixpath.dirname(path), str(extended_name.value))
            )
            below = names(target, depth + 1)
            variables = variables if below is None else below
        return variables

    return names(path, 0) or frozenset()


@dataclass(frozen=True, slots=True)
class UntrustedSpecs:
    """Specs of a stranger's change; `base` is what it changes, None if that is not known."""

    base: BaseVersion | None = None

    def refused_variables(self, file: str, root: TreeNode) -> dict[str, Diagnostic]:
        """What the spec of that name lists and its base version does not, each with the error."""
        listed = listed_environment(root)
        known = self.base.environment_names(file) if listed and self.base is not None else ()
        if self.base is None:
            reason = "--untrusted allows no variable without --base-ref"
        else:
            reason = f"this spec does not list it in {self.base.commit[:12]}"
        return {
            name: Diagnostic.error(
                "R2B143",
                f"an untrusted spec cannot read {clip(name)}: {reason}",
                item.span,
                "remove it; a maintainer can add it to this spec in the base branch",
            )
            for name, item in listed.items()
            if name not in known
        }


def untrusted_specs(folder: Path, *, untrusted: bool, base_ref: str) -> UntrustedSpecs | None:
    """What ``--untrusted`` and ``--base-ref`` say; None without the former.

    Args:
        folder: a folder of the repository.
        untrusted: whether specs are a stranger's.
        base_ref: the commit that the change is based on; empty if it is not known.

    Raises:
        UsageError: there is a base, and nothing is compared with it.
        BaseVersionError: the base cannot be read.
    """
    if untrusted:
        return UntrustedSpecs(base_version(base_ref, folder) if base_ref else None)
    if base_ref:
        raise UsageError("--base-ref needs --untrusted", hint="Add --untrusted.")
    return None
