"""`r2bspec data`: the datasets that specs name, and the bags on disk."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import click
import msgspec

from r2bspec.bags.recording import TimeWindow, WritableStorage
from r2bspec.cli.completion import complete_dataset
from r2bspec.cli.shared_options import format_option
from r2bspec.cli.text_output import print_table
from r2bspec.diagnostics.quote import printable
from r2bspec.errors import ExitStatus, UsageError
from r2bspec.language.quantities import Duration
from r2bspec.report.output import console, echo, echo_json

if TYPE_CHECKING:
    from r2bspec.bags.recording import BagIndex, BagLocation, TopicInfo
    from r2bspec.datasets.synthesis import Progress


@click.group(name="data")
def command() -> None:
    """List, create, inspect and verify datasets and bags."""


@command.command(name="list")
@format_option()
def list_datasets(output_format: str) -> None:
    """List the datasets that a spec can name.

    Synthetic ones are rendered on first use. A folder of that name under $R2B_DATASETS takes
    precedence.
    """
    from r2bspec.datasets.catalogue import SEQUENCES, index, known_datasets, locate_dataset

    folders = {name: locate_dataset(name) for name in known_datasets()}
    if output_format == "json":
        echo_json(
            [
                {
                    "name": name,
                    "kind": location.kind,
                    "path": location.path and str(location.path),
                    "topics": sorted(index(location).topics)
                    if location.kind == "synthetic"
                    else None,
                }
                for name, location in folders.items()
            ]
        )
        return
    rows = [
        (
            name,
            str(location.path or "synthetic"),
            SEQUENCES[name].description if name in SEQUENCES else "",
        )
        for name, location in folders.items()
    ]
    print_table(("dataset", "source", "content"), rows)


@command.command()
@click.argument("dataset", shell_complete=complete_dataset)
@click.option(
    "--topics", multiple=True, metavar="TOPIC[,TOPIC…]", help="Only these topics.  [default: all]"
)
@click.option("--window", metavar="START:END", help="The window, such as '0 s:0.5 s'.")
@click.option(
    "--storage",
    type=click.Choice(get_args(WritableStorage)),
    default="sqlite3",
    show_default=True,
    help="The storage format of the bag.",
)
@format_option()
def make(
    dataset: str,
    topics: tuple[str, ...],
    window: str | None,
    storage: Any,
    output_format: str,
) -> None:
    """Create a synthetic DATASET in the cache and print its path."""
    from r2bspec.bags.bag_index import index_bag
    from r2bspec.datasets.synthesis import make as make_dataset

    _require_cache()
    names = [name.strip() for value in topics for name in value.split(",") if name.strip()]
    selected_window = _window(window)
    with _progress_bar(f"creating {dataset}") as progress:
        made = make_dataset(
            dataset, names or None, selected_window, storage=storage, progress=progress
        )
    if output_format == "json":
        echo_json({"path": str(made.path), "sha256": made.content_sha256, "made": made.made})
        return
    state = "created" if made.made else "already in the cache"
    if made.damaged:
        state = "created again: the one in the cache was damaged"
    _print_index(index_bag(made.path), f"{made.path}, {state}", made.content_sha256)


def _require_cache() -> None:
    """See that a dataset would be there after this call.

    Raises:
        DataError: the cache of the user is not used, and the folder in its place ends with the
            process.
    """
    from r2bspec.bags.recording import DataError
    from r2bspec.datasets.catalogue import CACHE_KIND
    from r2bspec.safe_io.cache_folder import cache_folder, cache_path

    try:
        cache_folder(CACHE_KIND)
    except OSError as error:
        raise DataError(
            f"the cache {cache_path(CACHE_KIND)} cannot keep a dataset: {error.strerror or error}",
            code="R2B311",
            hint="name another folder by XDG_CACHE_HOME",
        ) from error


@command.command()
@click.argument("bag", shell_complete=complete_dataset)
@format_option()
def info(bag: str, output_format: str) -> None:
    """Print the content of BAG (a path, or the name of a dataset).

    The sha256 of a bag on disk can be pinned in a spec; 'data make' prints that of a synthetic one.
    """
    from r2bspec.bags.integrity import hash_files
    from r2bspec.datasets.catalogue import index, locate

    location = locate(bag, Path.cwd())
    result = index(location)
    digest = "" if location.path is None else hash_files(location.path)
    if output_format == "json":
        echo_json({**msgspec.to_builtins(result), "sha256": digest})
    else:
        _print_index(result, _origin(location), digest)
        facts = [*_facts(location.path, result)] if location.path is not None else []
        for line in ["", *facts] if facts else []:
            echo(line)


def _facts(path: Path, index: BagIndex) -> Iterator[str]:
    """Return what is unusual: files, profiles, times and stamps."""
    from r2bspec.bags.bag_index import unnamed_files
    from r2bspec.bags.offered_qos import offered_profile
    from r2bspec.bags.recorded_parts import find_parts
    from r2bspec.bags.recorded_times import times_of_bag

    if unnamed := unnamed_files(path, index):
        yield f"{', '.join(unnamed)} is not part of it: metadata.yaml does not name it."
    times = times_of_bag(path, index) or {}
    if (parts := find_parts(index, times)) is not None:
        yield f"It has {parts.text}: use '{parts.window_text}'."
    for topic, found in times.items():
        if found.clock_text:
            yield f"{printable(topic)} {found.clock_text}."
    for topic, info in index.topics.items():
        offered = offered_profile(info.qos)
        if offered is not None and (words := offered.words()):
            yield f"{printable(topic)} was offered with {', '.join(words)}."


@command.command(epilog=f"Exit status {ExitStatus.FINDINGS_OR_FAILED} if something is wrong.")
@click.argument("bag", shell_complete=complete_dataset)
@format_option()
@click.pass_context
def verify(context: click.Context, bag: str, output_format: str) -> None:
    """Read the whole BAG (a path, or the name of a dataset) and check its metadata.

    A synthetic dataset that is not in the cache is created first.
    """
    from r2bspec.bags.integrity import verify as verify_bag

    path = _bag_on_disk(bag)
    problems = verify_bag(path)
    if output_format == "json":
        echo_json({"path": str(path), "problems": problems})
    else:
        for problem in problems:
            echo(problem)
        if not problems:
            echo(f"{path} is consistent")
    context.exit(ExitStatus.FINDINGS_OR_FAILED if problems else ExitStatus.OK)


def _bag_on_disk(bag: str) -> Path:
    """Return the place of a bag or a dataset; a synthetic one is created.

    Raises:
        DataError: there is neither.
    """
    if os.path.exists(bag):  # noqa: PTH110 - a name may be too long
        return Path(bag)
    from r2bspec.datasets.catalogue import locate
    from r2bspec.datasets.synthesis import make as make_dataset

    location = locate(bag, Path.cwd())
    if location.path is not None:
        return location.path
    with _progress_bar(f"creating {bag}") as progress:
        return make_dataset(bag, progress=progress).path


def _window(text: str | None) -> TimeWindow | None:
    """Return the window of the option; None for everything."""
    if text is None:
        return None
    first, colon, last = (part.strip() for part in text.partition(":"))
    try:
        if not colon:
            raise ValueError("it has no colon")
        start, end = (Duration.parse(part) if part else None for part in (first, last))
    except ValueError as error:
        raise UsageError(
            f"{text!r} is not a window: {error}", hint="Write START:END, such as '0 s:0.5 s'."
        ) from error
    return TimeWindow(start_ns=start.ns if start else 0, end_ns=end.ns if end else None)


def _origin(location: BagLocation) -> str:
    return (
        str(location.path) if location.path is not None else "not created yet: it is on first use"
    )


@contextmanager
def _progress_bar(title: str) -> Iterator[Progress | None]:
    """Yield a progress bar on stderr if it is a terminal, else None."""
    if not sys.stderr.isatty() or os.environ.get("CI", "").lower() == "true":
        yield None
        return
    from rich.progress import Progress as Bar

    with Bar(console=console(sys.stderr), transient=True) as bar:
        task = bar.add_task(title, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _print_index(index: BagIndex, origin: str, sha256: str) -> None:
    from datetime import UTC, datetime

    start = datetime.fromtimestamp(index.start_ns / 1e9, UTC)
    for title, value in (
        ("bag", f"{index.name}{' (synthetic)' if index.synthetic else ''}"),
        ("at", origin),
        ("storage", _storage_text(index)),
        ("files", ", ".join(index.files)),
        ("starts", f"{start:%Y-%m-%d %H:%M:%S} UTC" if index.message_count else "never"),
        ("lasts", str(Duration(index.duration_ns))),
        ("messages", f"{index.message_count:,}"),
        ("sha256", sha256),
    ):
        if value:
            echo(f"{title:<9} {value}")
    if not index.topics:
        return
    echo()
    rows = [
        (
            printable(topic.name),
            printable(topic.type_text),
            f"{topic.count:,}",
            _rate_text(topic, index),
            "" if topic.max_message_bytes is None else f"{topic.max_message_bytes:,} B",
        )
        for topic in index.topics.values()
    ]
    print_table(("topic", "type", "messages", "rate", "largest"), rows, right_columns=(2, 3, 4))


def _rate_text(topic: TopicInfo, index: BagIndex) -> str:
    if not topic.rate_hz:
        return ""
    # Over the length of the bag, in which the topic may have begun late or ended early.
    least = "" if index.synthetic or topic.span_ns is not None else "≥ "
    return f"{least}{topic.rate_hz:.4g} Hz"


def _storage_text(index: BagIndex) -> str:
    how = "" if index.compression == "none" else f", each {index.compression} compressed"
    return f"{index.storage}{how}"
