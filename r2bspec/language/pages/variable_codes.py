"""R2B120 to R2B129, R2B142, R2B143: references, secrets, and the options --set and --var."""

from __future__ import annotations

from r2bspec.diagnostics.code_pages import Page
from r2bspec.diagnostics.diagnostic import Severity


def _page(slug: str, code: str, title: str, why: str, failing: str, passing: str) -> Page:
    return Page(slug, code, title, Severity.ERROR, why, failing, passing)


VARIABLE_PAGES = (
    _page(
        "unknown-variable",
        "R2B120",
        "an unknown variable",
        "$(var name) is replaced by a value under 'variables:'. An undeclared variable has none.",
        "variables: {rate: 30 Hz}\nbenchmark: {rates: [$(var rat)]}\n",
        "variables: {rate: 30 Hz}\nbenchmark: {rates: [$(var rate)]}\n",
    ),
    _page(
        "environment-variable-not-listed",
        "R2B121",
        "an environment variable that is not listed",
        "Environment variables that a spec reads must be listed under 'environment:'. This "
        "documents them, and prevents secrets from being read by accident.",
        "title: $(env HOME)\n",
        "environment: [HOME]\ntitle: $(env HOME)\n",
    ),
    _page(
        "environment-variable-not-set",
        "R2B122",
        "an environment variable that is not set",
        "The finding depends on this machine: where the variable is set, the same spec is valid.",
        "environment: [R2BSPEC_SURELY_UNSET]\ntitle: $(env R2BSPEC_SURELY_UNSET)\n",
        "environment: [HOME]\ntitle: $(env HOME)\n",
    ),
    _page(
        "malformed-reference",
        "R2B123",
        "a malformed reference",
        "Only $(var name) and $(env NAME) are supported. There are no expressions and no "
        "commands, so reading a spec never executes anything.",
        "title: $(find my_package)/config\n",
        "variables: {config: ./config}\ntitle: $(var config)\n",
    ),
    _page(
        "variable-in-variable",
        "R2B124",
        "a variable that refers to a variable",
        "The order of variables would matter, and cycles would be possible.",
        "variables: {width: 1280, size: $(var width)x720}\n",
        "variables: {width: 1280}\ntitle: $(var width)x720\n",
    ),
    _page(
        "reference-not-allowed",
        "R2B125",
        "a reference where none is supported",
        "References are supported in values, and in keys that are topics. Other keys are names "
        "that identify results. 'extends' is resolved before variables are known.",
        "variables: {x: a}\nmonitors:\n  $(var x): {topic: t, format: std_msgs/msg/Header}\n",
        "variables: {x: a}\nmonitors:\n  a: {topic: $(var x), format: std_msgs/msg/Header}\n",
    ),
    _page(
        "duplicate-key-after-substitution",
        "R2B126",
        "a duplicate key after substitution",
        "One of the two entries would be lost.",
        "variables: {x: a}\ndata_loader: {bag: b, topics: {/$(var x): c, /a: d}}\n",
        "variables: {x: a}\ndata_loader: {bag: b, topics: {/$(var x): c, /e: d}}\n",
    ),
    _page(
        "invalid-set-option",
        "R2B127",
        "an invalid --set option",
        "--set PATH=VALUE replaces a value that the document has, or sets a key of the language "
        "that it does not have; for example --set benchmark.iterations=3. Nodes, monitors and "
        "other entries with names of their own must be there, so that a misspelt path is noticed.",
        "",
        "",
    ),
    _page(
        "invalid-var-option",
        "R2B128",
        "an invalid --var option",
        "--var NAME=VALUE replaces the value of a variable that the document declares, and that is "
        "not an axis of the matrix.",
        "",
        "",
    ),
    _page(
        "substitution-too-large",
        "R2B129",
        "a document that is too large after substitution",
        "Long values that are inserted often, and 'repeat' with many instances, can fill the "
        "memory. The numbers of nodes, inputs, monitors and requirements are limited, too.",
        "",
        "",
    ),
    _page(
        "secret-not-usable",
        "R2B142",
        "a secret where its value is needed",
        "A variable whose name or value looks like a secret is read only when a process starts, so "
        "that no message, plan or report can show it. A bag, a duration or a topic is needed "
        "before. Use another variable, or another name for one that holds no secret.",
        "environment: [HOME_TOKEN]\nname: $(env HOME_TOKEN)\n",
        "environment: [HOME_TOKEN]\ntitle: $(env HOME_TOKEN)\n",
    ),
    _page(
        "environment-not-in-base",
        "R2B143",
        "an environment variable of an untrusted spec",
        "With --untrusted, a spec may read the environment variables that its version in the base "
        "(--base-ref) lists, and no other: otherwise a stranger's change could read the secrets of "
        "the machine that tests it. The error cannot be waived.",
        "",
        "",
    ),
)
