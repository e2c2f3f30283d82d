"""R2B302 to R2B313: bags and datasets that cannot be used as they are."""

from __future__ import annotations

from r2bspec.check.example_spec import example
from r2bspec.check.pages._page import error_page
from r2bspec.diagnostics.code_pages import Page
from r2bspec.diagnostics.diagnostic import Severity
from r2bspec.language.bag_formats import TITLES_TEXT

DATA_PAGES = (
    error_page(
        "R2B302",
        "the metadata of a bag cannot be read",
        "metadata.yaml says which files a bag has and how they are stored. Where it is missing or "
        "broken, 'ros2 bag reindex' writes it anew.",
    ),
    error_page(
        "R2B303",
        "a storage file of a bag is missing",
        "metadata.yaml names files that are not beside it, so messages are missing. Bags are "
        "copied as a whole folder.",
    ),
    error_page(
        "R2B304",
        "a storage file of a bag cannot be read",
        f"The file is damaged, cut short, or no {TITLES_TEXT} file at all. Lengths, counts "
        "and checksums are compared as far as the format has them.",
    ),
    error_page(
        "R2B305",
        "a Git LFS pointer stands in the place of a bag",
        "The repository was cloned without its large files; 'git lfs pull' fetches them.",
    ),
    Page(
        code="R2B307",
        title="a dataset that nobody knows",
        severity=Severity.ERROR,
        why="A bag without a '/' is the name of a dataset: a folder in $R2B_DATASETS, or one of "
        "those that 'r2bspec data list' shows.",
        failing=example(data_loader="{bag: r2b_storge, topics: {/d455_1_rgb_image: image_raw}}"),
        passing=example(data_loader="{bag: r2b_storage, topics: {/d455_1_rgb_image: image_raw}}"),
    ),
    error_page(
        "R2B310",
        "the metadata of a bag disagrees with its files",
        "Topics, types or counts differ, so one of the two is wrong. After a recording that was "
        "cut short, 'ros2 bag reindex' writes what is there.",
    ),
    error_page(
        "R2B311",
        "a dataset could not be written",
        "Datasets are rendered on first use into a cache, which needs space and the permission to "
        "write. XDG_CACHE_HOME says where it is.",
    ),
    error_page(
        "R2B312",
        "the bag is not the one that the spec pins",
        "Its content has another SHA-256 than 'sha256' of the bag says. Results of different data "
        "cannot be compared.",
    ),
    error_page(
        "R2B313",
        "a recording was not closed",
        "Beside the sqlite3 file lies its journal, with messages that the file itself lacks: it is "
        "still being written, or the recorder was killed. Read as it is, it would hold fewer "
        "messages than were recorded.",
    ),
)
