"""Making sure that the bag of a plan is there, and that it is the one that was meant."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from r2bspec.bags.digest import hash_files
from r2bspec.bags.recording import Window
from r2bspec.datasets.locate_bag import locate
from r2bspec.datasets.synthesis import make
from r2bspec.execute.errors import DatasetMismatchError
from r2bspec.execute.progress import Progress
from r2bspec.plan.plan import DatasetPlan


@dataclass(frozen=True)
class ResolvedDataset:
    """A bag on disk, and what the record says of it."""

    path: Path
    provenance: dict[str, Any]


def obtain_dataset(plan: DatasetPlan, base_dir: Path, progress: Progress) -> ResolvedDataset:
    """Find the bag, or make it if it is a synthetic one that is not in the cache.

    Raises:
        DataError: it is not there, or cannot be made.
        DatasetMismatchError: its hash is not the one that the spec pins.
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
            f"{plan.source} is not the bag that the spec pins: its hash is {digest}",
            hint="Fetch the right bag, or update data_loader.bag.sha256.",
        )
    return ResolvedDataset(path, provenance | {"path": str(path), "sha256": digest})
