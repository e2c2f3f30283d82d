"""Locating or synthesising the bag of a plan, and checking its hash."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from r2bspec.bags.integrity import hash_files
from r2bspec.bags.recording import Window
from r2bspec.datasets.locate_bag import locate
from r2bspec.datasets.synthesis import make
from r2bspec.execute.errors import DatasetMismatchError
from r2bspec.execute.progress import Progress
from r2bspec.plan.plan import DatasetPlan


@dataclass(frozen=True)
class ResolvedDataset:
    """A bag on disk, and its provenance for the record."""

    path: Path
    provenance: dict[str, Any]


def obtain_dataset(plan: DatasetPlan, base_dir: Path, progress: Progress) -> ResolvedDataset:
    """Locate the bag, or synthesise it if it is a synthetic one that is not in the cache.

    Raises:
        DataError: it does not exist, or cannot be synthesised.
        DatasetMismatchError: its hash differs from the one in the spec.
    """
    location = locate(plan.source, base_dir)
    provenance: dict[str, Any] = {"source": plan.source, "kind": location.kind}
    if location.path is None:
        made = make(
            plan.source,
            [each.bag_topic for each in plan.topics],
            Window(start_ns=plan.start_ns, end_ns=plan.end_ns),
            progress=progress.step,
        )
        path, digest = made.path, made.content_sha256
        if made.damaged:
            progress.note(f"the dataset {plan.source} in the cache was damaged; it was made anew")
    else:
        path = location.path
        digest = hash_files(path)
    if plan.sha256 and digest.removeprefix("sha256:") != plan.sha256.removeprefix("sha256:"):
        raise DatasetMismatchError(
            f"the hash of {plan.source} is {digest}, not the one in the spec",
            hint="Use the bag that the spec expects, or update data_loader.bag.sha256.",
        )
    return ResolvedDataset(path, provenance | {"path": str(path), "sha256": digest})
