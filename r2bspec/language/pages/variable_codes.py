"""R2B120 to R2B129, R2B142, R2B143: variables, the environment, and options for values."""

from __future__ import annotations

from r2bspec.diagnostics.code_pages import Page
from r2bspec.diagnostics.diagnostic import Severity


def _page(code: str, title: str, why: str, failing: str, passing: str) -> Page:
    return Page(code, title, Severity.ERROR, why, failing, passing)


VARIABLE_PAGES = (
    _page(
        "R2B120",
        "an unknown variable",
        "$(var name) stands for what 'variables:' says; an empty text in its place would be a "
        "value nobody chose.",
        "variables: {rate: 30 Hz}\nbenchmark: {rates: [$(var rat)]}\n",
        "variables: {rate: 30 Hz}\nbenchmark: {rates: [$(var rate)]}\n",
    ),
    _page(
        "R2B121",
        "the environment variable is not listed",
        "What a benchmark takes from the environment is a part of it. Listing it under "
        "'environment:' shows it to every reader, and keeps secrets from being read by accident.",
        "title: $(env HOME)\n",
        "environment: [HOME]\ntitle: $(env HOME)\n",
    ),
    _page(
        "R2B122",
        "the environment variable is not set",
        "It depends on this machine: the same spec is right where the variable is set.",
        "environment: [R2BSPEC_SURELY_UNSET]\ntitle: $(env R2BSPEC_SURELY_UNSET)\n",
        "environment: [HOME]\ntitle: $(env HOME)\n",
    ),
    _page(
        "R2B123",
        "something that begins like a reference",
        "Only $(var name) and $(env NAME) are replaced. There are no expressions and no commands "
        "in a spec, so that reading one never runs anything.",
        "title: $(find my_package)/config\n",
        "variables: {config: ./config}\ntitle: $(var config)\n",
    ),
    _page(
        "R2B124",
        "a variable that refers to a variable",
        "Order would begin to matter, and two variables could wait for each other.",
        "variables: {width: 1280, size: $(var width)x720}\n",
        "variables: {width: 1280}\ntitle: $(var width)x720\n",
    ),
    _page(
        "R2B125",
        "a reference in a key that is no topic",
        "Names of nodes, monitors and objectives are the addresses of results; they do not "
        "change with a variable. Topics may.",
        "variables: {x: a}\nmonitors:\n  $(var x): {topic: t, format: std_msgs/msg/Header}\n",
        "variables: {x: a}\nmonitors:\n  a: {topic: $(var x), format: std_msgs/msg/Header}\n",
    ),
    _page(
        "R2B126",
        "two keys that become the same",
        "After substitution one of the two would be lost.",
        "variables: {x: a}\ndata_loader: {bag: b, topics: {/$(var x): c, /a: d}}\n",
        "variables: {x: a}\ndata_loader: {bag: b, topics: {/$(var x): c, /e: d}}\n",
    ),
    _page(
        "R2B127",
        "--set names nothing that exists",
        "--set replaces a value that the document has, so that a misspelt path cannot pass "
        "unnoticed. It takes PATH=VALUE, for example --set benchmark.iterations=3.",
        "",
        "",
    ),
    _page(
        "R2B128",
        "--var names an undeclared variable",
        "--var replaces the value of a variable that the document declares.",
        "",
        "",
    ),
    _page(
        "R2B129",
        "too much text is inserted",
        "A long value that is inserted very often can fill any memory.",
        "",
        "",
    ),
    _page(
        "R2B142",
        "a secret where its value is needed",
        "A variable whose name or value looks like a secret is read only when a process starts, so "
        "that no message, plan or report can show it. A bag, a duration or a topic is needed "
        "before. Use another variable, or another name for one that holds no secret.",
        "environment: [HOME_TOKEN]\nname: $(env HOME_TOKEN)\n",
        "environment: [HOME_TOKEN]\ntitle: $(env HOME_TOKEN)\n",
    ),
    _page(
        "R2B143",
        "an environment variable of an untrusted spec",
        "With --untrusted, a spec may read the environment variables that its version in the base "
        "(--base-ref) lists, and no other: otherwise a stranger's change could read the secrets of "
        "the machine that tests it. The error cannot be waived.",
        "",
        "",
    ),
)
