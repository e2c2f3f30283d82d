"""R2B130 to R2B149: declared variables, files and siblings that are extended, and the matrix."""

from __future__ import annotations

from r2bspec.diagnostics.code_pages import Page
from r2bspec.diagnostics.diagnostic import Severity


def _page(slug: str, code: str, title: str, why: str, failing: str, passing: str) -> Page:
    return Page(slug, code, title, Severity.ERROR, why, failing, passing)


REUSE_PAGES = (
    _page(
        "variable-of-wrong-type",
        "R2B130",
        "a variable's value is not of its type",
        "Whoever declares a type wants a wrong value to be told where it is given, and not where "
        "it is used.",
        "variables:\n  rate: {type: rate, value: 30 ms}\n",
        "variables:\n  rate: {type: rate, value: 30 Hz}\n",
    ),
    _page(
        "variable-not-among-choices",
        "R2B131",
        "a variable's value is not among its choices",
        "The list is the promise that only these values make sense.",
        "variables:\n  family: {value: 25h9, choices: [16h5, 36h11]}\n",
        "variables:\n  family: {value: 36h11, choices: [16h5, 36h11]}\n",
    ),
    _page(
        "variable-without-value",
        "R2B132",
        "a variable without a value",
        "Nothing is as good as any other value: the spec must say one, or --var must.",
        "variables:\n  rate: {type: rate}\n",
        "variables:\n  rate: {type: rate, value: 30 Hz}\n",
    ),
    _page(
        "extended-file-unreadable",
        "R2B133",
        "a file to build on cannot be read",
        "Paths are relative to the file in which they are written. What is named there is a YAML "
        "file with the keys of a spec.",
        "extends: ./there/is/no.yaml\n",
        "",
    ),
    _page(
        "extended-file-outside-folder",
        "R2B134",
        "a file to build on lies outside of the folder of the spec",
        "A spec of a stranger could otherwise show any file of this machine in its messages. "
        "--allow-path names further folders that may be read.",
        "extends: ../../../base.yaml\n",
        "",
    ),
    _page(
        "endless-extends",
        "R2B135",
        "a chain of 'extends' that does not end",
        "What builds on itself has no beginning; and a chain of very many is one that nobody can "
        "follow.",
        "graph:\n  nodes:\n    a: {extends: b}\n    b: {extends: a, python: my.Node}\n",
        "graph:\n  nodes:\n    a: {extends: b}\n    b: {python: my.Node}\n",
    ),
    _page(
        "unknown-sibling",
        "R2B136",
        "no sibling of that name to build on",
        "Inside an entry, 'extends' names another entry of the same map. Other files are extended "
        "at the top of the document.",
        "graph:\n  nodes:\n    left: {python: my.Node}\n    right: {extends: lefft}\n",
        "graph:\n  nodes:\n    left: {python: my.Node}\n    right: {extends: left}\n",
    ),
    _page(
        "unknown-matrix-variable",
        "R2B137",
        "the matrix names an unknown variable",
        "A case gives declared variables other values. One that nobody declared changes nothing, "
        "and all cases would be the same.",
        "variables: {threads: 1}\nmatrix: {axes: {thread: [2]}}\n",
        "variables: {threads: 1}\nmatrix: {axes: {threads: [2]}}\n",
    ),
    Page(
        "exclusion-without-effect",
        "R2B138",
        "an exclusion that excludes nothing",
        Severity.WARNING,
        "Most often a value is written in another way than in the axis.",
        'variables: {threads: 1}\nmatrix: {axes: {threads: [2]}, exclude: [{threads: "2"}]}\n',
        "variables: {threads: 1}\nmatrix: {axes: {threads: [2]}}\n",
    ),
    _page(
        "matrix-empty-or-too-large",
        "R2B139",
        "a matrix without cases, or with very many",
        "Without a case there is nothing to run. Very many are most often an axis too much.",
        "variables: {threads: 1}\nmatrix: {axes: {threads: [2]}, exclude: [{threads: 2}]}\n",
        "variables: {threads: 1}\nmatrix: {axes: {threads: [2]}}\n",
    ),
    _page(
        "case-not-selected",
        "R2B140",
        "it is not clear which case is meant",
        "A run and a plan are of one case; validate looks at all of them. --case chooses one, by "
        "its values or by its name.",
        "variables: {threads: 1}\nmatrix: {axes: {threads: [1, 2]}}\n",
        "variables: {threads: 1}\nmatrix: {axes: {threads: [2]}}\n",
    ),
    _page(
        "duplicate-case",
        "R2B141",
        "two cases of one name",
        "Results are kept by the name of the case; one of the two would be lost.",
        "variables: {threads: 1}\nmatrix: {axes: {threads: [2, 2]}}\n",
        "variables: {threads: 1}\nmatrix: {axes: {threads: [2]}}\n",
    ),
)
