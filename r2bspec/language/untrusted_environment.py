"""The variables that a spec of a stranger's change may read.

With ``--untrusted``, `environment` may list only what the base version of the same spec lists. All
else is an error at its place, and is not read.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from r2bspec.diagnostics import Diagnostic, Severity
from r2bspec.diagnostics.quote import clip
from r2bspec.errors import UsageError
from r2bspec.language.base_version import BaseVersion, base_version
from r2bspec.language.located_tree import TreeNode
from r2bspec.language.variable_declarations import listed_environment


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
            name: Diagnostic(
                "R2B143",
                Severity.ERROR,
                f"an untrusted spec cannot read {clip(name)}: {reason}",
                item.span,
                help="remove it; a maintainer can add it to this spec in the base branch",
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
        raise UsageError("--base-ref needs --untrusted")
    return None
