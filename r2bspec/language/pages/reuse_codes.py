"""R2B130 to R2B141: declared variables, 'extends', and the matrix."""

from __future__ import annotations

from r2bspec.diagnostics.code_pages import Page
from r2bspec.diagnostics.diagnostic import Severity


def _page(slug: str, code: str, title: str, why: str, failing: str, passing: str) -> Page:
    return Page(slug, code, title, Severity.ERROR, why, failing, passing)


REUSE_PAGES = (
    _page(
        "variable-of-wrong-type",
        "R2B130",
        "a variable of the wrong type",
        "The value does not have the declared type. It is reported where it is set, not where it "
        "is used.",
        "variables:\n  rate: {type: rate, value: 30 ms}\n",
        "variables:\n  rate: {type: rate, value: 30 Hz}\n",
    ),
    _page(
        "variable-not-among-choices",
        "R2B131",
        "a variable with a value that is not one of its choices",
        "The variable accepts only the values listed under 'choices'.",
        "variables:\n  family: {value: 25h9, choices: [16h5, 36h11]}\n",
        "variables:\n  family: {value: 36h11, choices: [16h5, 36h11]}\n",
    ),
    _page(
        "variable-without-value",
        "R2B132",
        "a variable without a value",
        "The spec or --var must set a value.",
        "variables:\n  rate: {type: rate}\n",
        "variables:\n  rate: {type: rate, value: 30 Hz}\n",
    ),
    _page(
        "extended-file-unreadable",
        "R2B133",
        "an extended file that cannot be read",
        "The path is relative to the file in which it is written. The extended file is a YAML file "
        "with the keys of a spec.",
        "extends: ./there/is/no.yaml\n",
        "",
    ),
    _page(
        "extended-file-outside-folder",
        "R2B134",
        "an extended file outside of the folder of the spec",
        "Otherwise the messages about an untrusted spec could show any file of this machine. "
        "--allow-path allows further folders.",
        "extends: ../../../base.yaml\n",
        "",
    ),
    _page(
        "endless-extends",
        "R2B135",
        "an endless or too long chain of 'extends'",
        "A file or an entry cannot extend itself, directly or through others. The length of a "
        "chain is limited.",
        "graph:\n  nodes:\n    a: {extends: b}\n    b: {extends: a, python: my.Node}\n",
        "graph:\n  nodes:\n    a: {extends: b}\n    b: {python: my.Node}\n",
    ),
    _page(
        "unknown-sibling",
        "R2B136",
        "an unknown sibling in 'extends'",
        "Inside an entry, 'extends' names another entry of the same map. At the top of the "
        "document, it names files.",
        "graph:\n  nodes:\n    left: {python: my.Node}\n    right: {extends: lefft}\n",
        "graph:\n  nodes:\n    left: {python: my.Node}\n    right: {extends: left}\n",
    ),
    _page(
        "unknown-matrix-variable",
        "R2B137",
        "an unknown variable in the matrix",
        "The cases of a matrix set variables that the document declares. An undeclared one would "
        "have no effect.",
        "variables: {threads: 1}\nmatrix: {axes: {thread: [2]}}\n",
        "variables: {threads: 1}\nmatrix: {axes: {threads: [2]}}\n",
    ),
    Page(
        "exclusion-without-effect",
        "R2B138",
        "an exclusion that matches no case",
        Severity.WARNING,
        "Usually a value is written differently from the axis, for example with quotes.",
        'variables: {threads: 1}\nmatrix: {axes: {threads: [2]}, exclude: [{threads: "2"}]}\n',
        "variables: {threads: 1}\nmatrix: {axes: {threads: [2]}}\n",
    ),
    _page(
        "matrix-empty-or-too-large",
        "R2B139",
        "a matrix without cases, or with too many",
        "Without a case there is nothing to run; the number of cases is limited, and so is that of "
        "their values together: each case is checked as a document of its own.",
        "variables: {threads: 1}\nmatrix: {axes: {threads: [2]}, exclude: [{threads: 2}]}\n",
        "variables: {threads: 1}\nmatrix: {axes: {threads: [2]}}\n",
    ),
    _page(
        "case-not-selected",
        "R2B140",
        "no case selected, or an unknown one",
        "A run and a plan need one case; 'validate' checks all of them. --case selects one, by its "
        "values or by its name.",
        "variables: {threads: 1}\nmatrix: {axes: {threads: [1, 2]}}\n",
        "variables: {threads: 1}\nmatrix: {axes: {threads: [2]}}\n",
    ),
    _page(
        "duplicate-case",
        "R2B141",
        "two cases with the same name",
        "Results are identified by the name of the case; one of the two would be lost.",
        "variables: {threads: 1}\nmatrix: {axes: {threads: [2, 2]}}\n",
        "variables: {threads: 1}\nmatrix: {axes: {threads: [2]}}\n",
    ),
)
