"""R2B600 to R2B612 and R2B660 to R2B663: the command line, its input files, and reports."""

from __future__ import annotations

from r2bspec.check.pages._page import error_page

FILE_PAGES = (
    error_page(
        "unclassified-error",
        "R2B600",
        "error without its own code",
        "The message describes the error.",
    ),
    error_page(
        "wrong-usage",
        "R2B601",
        "wrong usage of the command",
        "The arguments request something that the command cannot do; '--help' of the verb lists "
        "its options.",
    ),
    error_page(
        "invalid-spec",
        "R2B602",
        "spec has errors",
        "A plan or run of an invalid spec would not mean what its author intended. 'r2bspec "
        "validate' shows the same findings.",
    ),
    error_page(
        "plan-unreadable",
        "R2B610",
        "plan cannot be read",
        "The file does not exist or is not readable. 'r2bspec plan SPEC -o FILE' writes a plan.",
    ),
    error_page(
        "unsupported-plan",
        "R2B611",
        "file is not a plan of this version",
        "Plans are JSON with 'r2bspec_plan: 1'. Create a plan of another version again from its "
        "spec.",
    ),
    error_page(
        "invalid-plan",
        "R2B612",
        "invalid plan",
        "A value is missing, unknown or of the wrong type, for example because the plan was edited "
        "by hand. Change the spec instead.",
    ),
    error_page(
        "invalid-report-option",
        "R2B660",
        "invalid report option",
        "The format does not exist, or two reports have the same destination. 'r2bspec report "
        "--formats' lists the formats.",
    ),
    error_page(
        "report-not-possible",
        "R2B661",
        "report cannot be created",
        "A library of the format is not installed, or the run has no samples for it.",
    ),
    error_page(
        "not-a-result",
        "R2B662",
        "file is neither a result nor a report",
        "Results are read from a run folder or its result.json. The file is something else, or was "
        "written by another version.",
    ),
    error_page(
        "results-not-comparable",
        "R2B663",
        "results cannot be compared",
        "The results differ in the benchmark, its data, or what was measured, so a difference "
        "between them would not be a difference of the graph.",
    ),
)
