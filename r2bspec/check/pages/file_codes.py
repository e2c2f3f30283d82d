"""R2B600 to R2B612 and R2B660 to R2B663: the command line, files given to it, and reports."""

from __future__ import annotations

from r2bspec.check.pages._page import error_page

FILE_PAGES = (
    error_page(
        "unclassified-error",
        "R2B600",
        "something went wrong that has no code of its own",
        "The message says what it was.",
    ),
    error_page(
        "wrong-usage",
        "R2B601",
        "wrong usage of the command",
        "The command cannot do what it was asked for; '--help' of the verb says what it can.",
    ),
    error_page(
        "invalid-spec",
        "R2B602",
        "a spec with errors was given to a verb that needs a valid one",
        "A run or a plan of such a spec would mean something else than was meant. 'r2bspec "
        "validate' shows the same findings.",
    ),
    error_page(
        "plan-unreadable",
        "R2B610",
        "a plan cannot be read",
        "The file is not there, or may not be read. 'r2bspec plan SPEC -o FILE' writes one.",
    ),
    error_page(
        "unsupported-plan",
        "R2B611",
        "a file that is no plan of this version",
        "Plans are JSON with 'r2bspec_plan: 1'. One of another version may mean something else, "
        "and is written anew from its spec.",
    ),
    error_page(
        "invalid-plan",
        "R2B612",
        "a plan with a fault in it",
        "A value is missing, unknown or of the wrong kind, as it happens when plans are edited by "
        "hand. What is to change is changed in the spec.",
    ),
    error_page(
        "invalid-report-option",
        "R2B660",
        "a report was asked for in a way that cannot be",
        "There is no such format, or two reports would go to one place. 'r2bspec report --formats' "
        "lists the formats.",
    ),
    error_page(
        "report-not-possible",
        "R2B661",
        "a report cannot be made",
        "A library that its format needs is not installed, or the run has no samples for it.",
    ),
    error_page(
        "not-a-result",
        "R2B662",
        "a file is neither a result nor a report",
        "Results are read from a run folder or its result.json; the file is something else, or "
        "was written by another version.",
    ),
    error_page(
        "results-not-comparable",
        "R2B663",
        "results that cannot be compared",
        "They differ in more than their numbers: in the benchmark, its data, or what was measured. "
        "A difference between them would not be one of the graph.",
    ),
)
