"""R2B120 to R2B129: variables, the environment, and options that replace values."""

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
        "$(var name) stands for what 'variables:' says; an empty text in its place would be a "
        "value nobody chose.",
        "variables: {rate: 30 Hz}\nbenchmark: {rates: [$(var rat)]}\n",
        "variables: {rate: 30 Hz}\nbenchmark: {rates: [$(var rate)]}\n",
    ),
    _page(
        "environment-variable-not-listed",
        "R2B121",
        "the environment variable is not listed",
        "What a benchmark takes from the environment is a part of it. Listing it under "
        "'environment:' shows it to every reader, and keeps secrets from being read by accident.",
        "title: $(env HOME)\n",
        "environment: [HOME]\ntitle: $(env HOME)\n",
    ),
    _page(
        "environment-variable-not-set",
        "R2B122",
        "the environment variable is not set",
        "It depends on this machine: the same spec is right where the variable is set.",
        "environment: [R2BSPEC_SURELY_UNSET]\ntitle: $(env R2BSPEC_SURELY_UNSET)\n",
        "environment: [HOME]\ntitle: $(env HOME)\n",
    ),
    _page(
        "malformed-reference",
        "R2B123",
        "something that begins like a reference",
        "Only $(var name) and $(env NAME) are replaced. There are no expressions and no commands "
        "in a spec, so that reading one never runs anything.",
        "title: $(find my_package)/config\n",
        "variables: {config: ./config}\ntitle: $(var config)\n",
    ),
    _page(
        "variable-in-variable",
        "R2B124",
        "a variable that refers to a variable",
        "Order would begin to matter, and two variables could wait for each other.",
        "variables: {width: 1280, size: $(var width)x720}\n",
        "variables: {width: 1280}\ntitle: $(var width)x720\n",
    ),
    _page(
        "reference-not-allowed",
        "R2B125",
        "a reference in a key that is no topic",
        "Names of nodes, monitors and objectives are the addresses of results; they do not "
        "change with a variable. Topics may.",
        "variables: {x: a}\nmonitors:\n  $(var x): {topic: t, format: std_msgs/msg/Header}\n",
        "variables: {x: a}\nmonitors:\n  a: {topic: $(var x), format: std_msgs/msg/Header}\n",
    ),
    _page(
        "duplicate-key-after-substitution",
        "R2B126",
        "two keys that become the same",
        "After substitution one of the two would be lost.",
        "variables: {x: a}\ndata_loader: {bag: b, topics: {/$(var x): c, /a: d}}\n",
        "variables: {x: a}\ndata_loader: {bag: b, topics: {/$(var x): c, /e: d}}\n",
    ),
    _page(
        "invalid-set-option",
        "R2B127",
        "--set names nothing that exists",
        "--set replaces a value that the document has, so that a misspelt path cannot pass "
        "unnoticed. It takes PATH=VALUE, for example --set benchmark.iterations=3.",
        "",
        "",
    ),
    _page(
        "invalid-var-option",
        "R2B128",
        "--var names an undeclared variable",
        "--var replaces the value of a variable that the document declares.",
        "",
        "",
    ),
    _page(
        "substitution-too-large",
        "R2B129",
        "too much text is inserted",
        "A long value that is inserted very often can fill any memory.",
        "",
        "",
    ),
)
