"""The inputs of the two sides of a gate, which have to be the same.

The messages of the recordings are compared by their content: other storage or compression is no
difference. Preprocessors are compared by their files, as far as these are known before they run
(`r2bspec.execute.identity`).

A recording that git does not have, such as one that is downloaded, is the head's on both sides. A
change must not put another one in its place: neither by a link, nor by a submodule, nor by a step
that rewrites it before it is played.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.bag_reader import read_messages
from r2bspec.bags.integrity import hash_files
from r2bspec.bags.recording import TimeWindow
from r2bspec.compare.base_tree import BaseTree
from r2bspec.compare.gate_rules import ALLOW_INPUT, GateChange
from r2bspec.datasets.catalogue import locate
from r2bspec.language.quantities import Size
from r2bspec.language.spec import Spec
from r2bspec.plan.plan import DatasetPlan, Plan
from r2bspec.record.graph_identity import GraphIdentity
from r2bspec.safe_io import git

_SHOWN_DIGITS = 12


class _Messages(NamedTuple):
    """The messages that are loaded."""

    messages: int
    size: int
    digest: str

    def __str__(self) -> str:
        return f"{self.messages:,} messages, {Size(self.size)} ({self.digest[:_SHOWN_DIGITS]})"


def share_recordings(tree: BaseTree, spec: Spec, base_dir: Path, *, take: bool) -> list[GateChange]:
    """Let the base play recordings that only the head has.

    Args:
        tree: the tree of the base.
        spec: the spec of the base, with the recordings of the head.
        base_dir: its folder, in that tree.
        take: replace also those that the base has.

    Returns:
        The recordings that the head has in git and the base does not.
    """
    changes = []
    for source in spec.data_loader.sources:
        place = Path(os.path.normpath(base_dir / source.path))
        if not source.path or not place.is_relative_to(tree.top):
            continue
        below = place.relative_to(tree.top)
        original = tree.head_top / below
        if (os.path.lexists(place) and not take) or not original.exists():
            continue
        if not os.path.lexists(place) and (brought := _brought_by_the_change(tree, below)):
            changes.append(GateChange(ALLOW_INPUT, ("data_loader",), *brought))
        _link(original, place)
    return changes


def _brought_by_the_change(tree: BaseTree, below: Path) -> tuple[str, str] | None:
    """Return what the base and the head have, if git knows a recording that the base lacks.

    Args:
        tree: the tree of the base.
        below: the path of the recording in the work tree of the head.
    """
    places = [below]
    real = (tree.head_top / below).resolve()
    if real.is_relative_to(tree.head_top):
        places.append(real.relative_to(tree.head_top))
    for place in places:
        for way in (place, *place.parents[:-1]):
            here = tree.head_top / way
            tracked = bool(git.output_of(tree.head_top, "ls-files", "--", str(way)))
            if os.path.lexists(here / ".git"):
                was, now = tree.submodules.get(str(way), ""), git.commit_of(here, "HEAD") or ""
                if (tracked or was) and was != now:
                    return _submodule_at(way, was), _submodule_at(way, now)
            elif tracked and (way == place or here.is_symlink()):
                return "", f"{below}, which git has now"
    return None


def _submodule_at(path: Path, commit: str) -> str:
    return f"{path} at {commit[:_SHOWN_DIGITS]}" if commit else ""


class Recordings(NamedTuple):
    """The recordings of both sides.

    Attributes:
        changes: those of which other messages are loaded.
        digests: the digests of their files. Whatever a run reads must be one of them.
    """

    changes: list[GateChange]
    digests: frozenset[str]


def compare_recordings(base: Plan, base_dir: Path, head: Plan, head_dir: Path) -> Recordings:
    """Compare the messages that both sides load."""
    changes: list[GateChange] = []
    digests: set[str] = set()
    datasets = zip(base.datasets or (base.dataset,), head.datasets or (head.dataset,), strict=False)
    for was, now in datasets if "load" in base.phases else ():
        places = locate(was.source, base_dir).path, locate(now.source, head_dir).path
        if places[0] is None or places[1] is None:
            texts = was.source, now.source
        else:
            files = hash_files(places[0]), hash_files(places[1])
            digests |= {*files}
            if files[0] == files[1]:
                continue
            texts = str(_loaded(was, places[0])), str(_loaded(now, places[1]))
        if texts[0] != texts[1]:
            changes.append(GateChange(ALLOW_INPUT, ("data_loader",), *texts))
    return Recordings(changes, frozenset(digests))


def _loaded(dataset: DatasetPlan, bag: Path) -> _Messages:
    """Return what is loaded of a bag, whatever its storage format and compression."""
    topics = [topic.bag_topic for topic in dataset.topics]
    transforms = ["/tf"] * dataset.publish_tf + ["/tf_static"] * dataset.publish_tf_static
    topics += [topic for topic in transforms if index_bag(bag).find(topic) is not None]
    window = TimeWindow(start_ns=dataset.start_ns, end_ns=dataset.end_ns)
    digest, count, size = hashlib.sha256(), 0, 0
    for message in read_messages(bag, topics, window):
        head = f"{message.topic} {message.time_ns} {len(message.data)} "
        digest.update(head.encode())
        digest.update(message.data)
        count, size = count + 1, size + len(message.data)
    return _Messages(count, size, digest.hexdigest())


_PREPARED = "preprocess."


def preprocessor_changes(
    base: GraphIdentity, head: GraphIdentity, plan: Plan
) -> Iterator[GateChange]:
    """Yield the files and programs of preprocessors that differ.

    A file beside theirs that may also belong to the graph is left to the comparison of the played
    messages.
    """
    shared = _shared_files(base, head, plan)
    for name in sorted(base.nodes.keys() | head.nodes.keys()):
        was, now = base.nodes.get(name), head.nodes.get(name)
        if not name.startswith(_PREPARED) or was is None or now is None:
            continue
        path = ("preprocessors", name.removeprefix(_PREPARED))
        files = [{file.path: file.sha256 for file in node.files} for node in (was, now)]
        for file in sorted((files[0].keys() | files[1].keys()) - shared):
            before, after = (digests.get(file, "") for digests in files)
            if before != after:
                was_text, now_text = (_shown(file, digest) for digest in (before, after))
                yield GateChange(ALLOW_INPUT, path, was_text, now_text)
        programs = [f"{node.package} {node.version}".strip() for node in (was, now)]
        if programs[0] != programs[1]:
            yield GateChange(ALLOW_INPUT, path, programs[0], programs[1])


def _shown(file: str, digest: str) -> str:
    return f"{file} ({digest[:_SHOWN_DIGITS]})" if digest else ""


def take_preprocessors(
    tree: BaseTree, base: GraphIdentity, head: GraphIdentity, plan: Plan
) -> None:
    """Copy the files of the head's preprocessors into the base, unless the graph may use them."""
    shared = _shared_files(base, head, plan)
    for name, node in head.nodes.items():
        for file in node.files if name.startswith(_PREPARED) else ():
            if file.path not in shared and not Path(file.path).is_absolute():
                (tree.top / file.path).parent.mkdir(parents=True, exist_ok=True)
                (tree.top / file.path).unlink(missing_ok=True)
                shutil.copyfile(tree.head_top / file.path, tree.top / file.path)


def _shared_files(base: GraphIdentity, head: GraphIdentity, plan: Plan) -> set[str]:
    """Return the files that may be of the graph, and that no preprocessor names."""
    nodes = [node for process in plan.processes_in("preprocess") for node in process.nodes]
    named = {Path(file).name for node in nodes for file in node.parameter_files or ()}
    for node in nodes:
        module = node.target.partition(".py:")[0].rpartition("/")[2]
        named |= {f"{module}.py", f"{module.rpartition('.')[0].rpartition('.')[2]}.py"}
    return {
        file.path
        for identity in (base, head)
        for name, node in identity.nodes.items()
        if not name.startswith(_PREPARED)
        for file in node.files
        if Path(file.path).name not in named
    }


def _link(original: Path, place: Path) -> None:
    if place.is_dir() and not place.is_symlink():
        shutil.rmtree(place)
    else:
        place.unlink(missing_ok=True)
    place.parent.mkdir(parents=True, exist_ok=True)
    place.symlink_to(original)
