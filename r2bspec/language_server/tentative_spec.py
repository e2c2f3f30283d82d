"""What can be known of a spec that is not complete yet.

While a spec is being written, it is never valid. To complete names from its bag and its nodes, what
is wrong is left out and what is missing is filled in with the examples of the schema, until the
rest is valid. Nothing of that is shown as a finding.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable
from typing import Any, Final

from r2bspec.check.check_context import Context
from r2bspec.check.engine import context_of
from r2bspec.diagnostics import Diagnostic, Path, Severity
from r2bspec.language.declaration import Rule, rule_at
from r2bspec.language.load_spec import LoadedSpec, load_spec
from r2bspec.language.located_tree import to_plain
from r2bspec.language.matrix import KEY as MATRIX
from r2bspec.language.yaml_scalars import to_yaml

_MAX_ROUNDS: Final = 8
"""Each round repairs all errors that are seen; a repaired value may have further ones."""


def tentative_context(loaded: LoadedSpec) -> Context | None:
    """The context of what is written, as far as it can be made valid; None if it cannot.

    Args:
        loaded: the document, with errors.
    """
    plain = to_plain(loaded.tree) if loaded.tree is not None else None
    if not isinstance(plain, dict):
        return None
    # Values may be shared, as those of aliases are.
    plain = copy.deepcopy(plain)
    plain.pop("extends", None)
    plain.pop(MATRIX, None)
    _fill(plain, ())
    for _ in range(_MAX_ROUNDS):
        attempt = load_spec(to_yaml(plain), file=loaded.file, environ={})
        if attempt.spec is not None:
            return context_of(attempt)
        if not _repair(plain, attempt.diagnostics):
            return None
    return None


def _repair(plain: dict[str, Any], found: Iterable[Diagnostic]) -> bool:
    """Remove what errors are about, deepest first, and fill in what is then missing."""
    before = copy.deepcopy(plain)
    paths = [one.path for one in found if one.severity is Severity.ERROR]
    for path in sorted(paths, key=len, reverse=True):
        if path:
            _remove(plain, path)
    _fill(plain, ())
    return plain != before


def _remove(plain: dict[str, Any], path: Path) -> None:
    owner: Any = plain
    for part in path[:-1]:
        try:
            owner = owner[part]
        except (KeyError, IndexError, TypeError):
            return
    last = path[-1]
    if isinstance(owner, dict):
        owner.pop(last, None)
    elif isinstance(owner, list) and isinstance(last, int) and last < len(owner):
        del owner[last]


def _fill(value: Any, path: Path) -> None:
    """Drop the keys without a value, and add the required ones that are missing."""
    if isinstance(value, list):
        for index, item in enumerate(value):
            _fill(item, (*path, index))
    if not isinstance(value, dict):
        return
    for key in [key for key, below in value.items() if below is None]:
        del value[key]
    rule = rule_at(path)
    if rule is not None and rule.keys is not None:
        for key in rule.required:
            if key not in value:
                value[key] = _example(rule.keys[key])
    if rule is not None and rule.values is not None and rule.about.at_least and not value:
        value.update(_example(rule))
    for key, below in value.items():
        _fill(below, (*path, key))


def _example(rule: Rule) -> Any:
    return copy.deepcopy(rule.about.examples[0]) if rule.about.examples else "example"
