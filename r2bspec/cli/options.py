"""Options that several verbs share."""

from __future__ import annotations

from collections.abc import Iterable

import click

sets_option = click.option(
    "--set",
    "sets",
    multiple=True,
    metavar="PATH=VALUE",
    help="Replace a value of the spec, such as benchmark.iterations=3; may be repeated.",
)

variables_option = click.option(
    "--var",
    "variables",
    multiple=True,
    metavar="NAME=VALUE",
    help="Give a declared variable another value; may be repeated.",
)


def parse_variables(options: Iterable[str]) -> dict[str, str]:
    """Split ``NAME=VALUE`` options.

    Raises:
        click.UsageError: one has no equals sign.
    """
    found = {}
    for option in options:
        name, equals, value = option.partition("=")
        if not equals:
            raise click.UsageError(f"--var takes NAME=VALUE, not {option!r}")
        found[name] = value
    return found
