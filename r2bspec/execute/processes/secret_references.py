"""The values of the secrets that a plan refers to, put in where a process is started.

A plan has ``$(env NAME)`` in place of the value of a secret (`r2bspec.language.secret_variables`).
Only the process that is started gets the value. What is printed or recorded has the reference.
"""

from __future__ import annotations

import fnmatch
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import msgspec

from r2bspec.execute.errors import SecretNotSetError
from r2bspec.language.secret_variables import is_secret_variable, secret_reference
from r2bspec.language.variables import OPENING
from r2bspec.plan.plan import NodePlan, Plan

_REFERENCE = re.compile(r"\$\((?P<kind>env|quoted_env) (?P<name>[A-Za-z_][A-Za-z0-9_]*)\)")


class SecretReferences:
    """Replaces references to the secrets that a plan may read.

    Args:
        names: the names, or patterns of names, under `environment` of the plan.
        environ: where the values are.
    """

    def __init__(self, names: Iterable[str], environ: Mapping[str, str]) -> None:
        self._names = tuple(names)
        self._environ = environ

    def in_words(self, argv: Sequence[str]) -> list[str]:
        """A command line; its program, which is looked for and named in errors, stays as it is."""
        return [*argv[:1], *map(self.in_text, argv[1:])]

    def in_environment(self, env: Mapping[str, str]) -> dict[str, str]:
        """The variables of a process."""
        return {name: self.in_text(value) for name, value in env.items()}

    def in_nodes(self, nodes: Iterable[NodePlan]) -> tuple[NodePlan, ...]:
        """Nodes, with the values in their parameters."""
        return tuple(
            msgspec.structs.replace(node, parameters=self.in_value(node.parameters))
            for node in nodes
        )

    def in_value(self, value: Any) -> Any:
        """A value as JSON has it, with the values in all of its texts."""
        if isinstance(value, str):
            return self.in_text(value)
        if isinstance(value, dict):
            return {key: self.in_value(each) for key, each in value.items()}
        if isinstance(value, list | tuple):
            return [self.in_value(each) for each in value]
        return value

    def in_text(self, text: str) -> str:
        """A text with the values in it, each inserted once: a value is not looked into.

        Raises:
            SecretNotSetError: a variable is not set.
        """
        return _REFERENCE.sub(self._value, text) if OPENING in text else text

    def require_set(self, plan: Plan) -> None:
        """See that every secret is there before anything is started.

        Raises:
            SecretNotSetError: a variable is not set.
        """
        for text in texts(msgspec.to_builtins((plan.processes, plan.setup, plan.after_ready))):
            self.in_text(text)

    def _value(self, found: re.Match[str]) -> str:
        name = found["name"]
        unchanged = secret_reference(name)  # what a text of a parameter file was before quoting
        if not any(fnmatch.fnmatchcase(name, pattern) for pattern in self._names):
            return unchanged
        value = self._environ.get(name)
        if value is None:
            raise SecretNotSetError(
                f"the environment variable {name}, to which the plan refers, is not set",
                hint=f"Set it, for example: export {name}=...",
            )
        if not is_secret_variable(name, value) and OPENING not in value:
            return unchanged
        if found["kind"] == "env":
            return value
        return json.dumps(value, ensure_ascii=False)[1:-1]


def texts(value: Any) -> Iterator[str]:
    """All texts in a value of dictionaries and lists, apart from keys."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for each in value.values():
            yield from texts(each)
    elif isinstance(value, list | tuple):
        for each in value:
            yield from texts(each)
