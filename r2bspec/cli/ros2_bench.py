"""``ros2 bench``: the command line of r2bspec as a command of ros2cli.

ros2cli loads the class by the entry point ``ros2cli.command``, and needs only its two methods and
its docstring. It inherits nothing, so that it can be loaded without ros2cli.
"""

from __future__ import annotations

import argparse


class BenchCommand:
    """State, run and gate performance benchmarks."""

    def add_arguments(self, parser: argparse.ArgumentParser, _cli_name: str) -> None:
        """Take every word after ``bench`` as it is."""
        from r2bspec._version import __version__
        from r2bspec.cli.main import VERBS

        width = max(map(len, VERBS))
        verbs = "\n".join(f"  {name:<{width}}  {text}" for name, text in VERBS.items())
        self._parser = parser
        parser.description = f"{parser.description}\n\nVerbs, as of r2bspec:\n{verbs}"
        parser.add_argument("-V", "--version", action="version", version=f"r2bspec {__version__}")
        words = parser.add_argument(
            "words",
            nargs=argparse.REMAINDER,
            metavar="...",
            help="a verb and its arguments; 'ros2 bench run --help' prints those of 'run'",
        )
        words.completer = _verbs  # type: ignore[attr-defined] # what argcomplete looks for

    def main(self, *, parser: argparse.ArgumentParser, args: argparse.Namespace) -> int:  # noqa: ARG002
        """Run the verb, and return its exit status. ``parser`` is that of ``ros2``."""
        from r2bspec.cli.main import main

        if not args.words:
            self._parser.print_help()
            return 0
        return main(args.words)


def _verbs(parsed_args: argparse.Namespace, **_asked: object) -> list[str]:
    """Return what may come first."""
    from r2bspec.cli.main import VERBS

    return [] if parsed_args.words else [*VERBS]
