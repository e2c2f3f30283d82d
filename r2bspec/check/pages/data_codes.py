"""R2B302 to R2B313: bags and datasets that cannot be used."""

from __future__ import annotations

from r2bspec.check.example_spec import example
from r2bspec.check.pages._page import error_page
from r2bspec.diagnostics.code_pages import Page
from r2bspec.diagnostics.diagnostic import Severity
from r2bspec.language.bag_formats import TITLES_TEXT

DATA_PAGES = (
    error_page(
        "bag-metadata-unreadable",
        "R2B302",
        "bag metadata cannot be read",
        "metadata.yaml lists the files of a bag and how they are stored. If it is missing or "
        "damaged, 'ros2 bag reindex' recreates it.",
    ),
    error_page(
        "bag-file-missing",
        "R2B303",
        "storage file of a bag is missing",
        "metadata.yaml lists files that are not in the folder, so messages are missing. Copy bags "
        "as whole folders.",
    ),
    error_page(
        "bag-file-unreadable",
        "R2B304",
        "storage file of a bag cannot be read",
        f"The file is damaged, truncated, or not an {TITLES_TEXT} file. Lengths, counts "
        "and checksums are compared as far as the format has them.",
    ),
    error_page(
        "git-lfs-pointer",
        "R2B305",
        "bag is a Git LFS pointer",
        "The repository was cloned without its large files; 'git lfs pull' downloads them.",
    ),
    Page(
        slug="unknown-dataset",
        code="R2B307",
        title="unknown dataset",
        severity=Severity.ERROR,
        why="A bag without a '/' is the name of a dataset: a folder in $R2B_DATASETS, or one of "
        "those that 'r2bspec data list' shows.",
        failing=example(data_loader="{bag: r2b_storge, topics: {/d455_1_rgb_image: image_raw}}"),
        passing=example(data_loader="{bag: r2b_storage, topics: {/d455_1_rgb_image: image_raw}}"),
    ),
    error_page(
        "bag-metadata-mismatch",
        "R2B310",
        "bag metadata does not match the files",
        "Topics, types or counts differ, so one of the two is wrong. If the recording was "
        "truncated, 'ros2 bag reindex' recreates the metadata from the files.",
    ),
    error_page(
        "dataset-not-writable",
        "R2B311",
        "dataset cannot be written",
        "Datasets are rendered on first use into a cache, which needs free space and write "
        "permission. XDG_CACHE_HOME sets its location.",
    ),
    error_page(
        "bag-digest-mismatch",
        "R2B312",
        "bag does not match its 'sha256'",
        "The SHA-256 of the bag differs from 'sha256' in the spec. Results of different data "
        "cannot be compared.",
    ),
    error_page(
        "recording-not-closed",
        "R2B313",
        "recording was not closed",
        "The sqlite3 file has a journal with messages that are not in the file itself: the bag is "
        "still being written, or the recorder was killed. Messages would be missing if it were "
        "read now.",
    ),
)
