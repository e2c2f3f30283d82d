"""The verbs that write the first files of a benchmark: ``init`` and ``interfaces``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from r2bspec.cli import shared_options as options
from r2bspec.cli.completion import complete_template
from r2bspec.cli.text_output import print_findings, show_findings
from r2bspec.diagnostics import did_you_mean
from r2bspec.diagnostics.plain_text import message_text
from r2bspec.diagnostics.quote import quote
from r2bspec.errors import ExitStatus, R2bspecError, UsageError
from r2bspec.language.quantities import Duration
from r2bspec.language.selected_spec import SelectionValues
from r2bspec.report.output import echo

if TYPE_CHECKING:
    from r2bspec.authoring.sources import FirstSpec
    from r2bspec.language.spec import Spec

_DEFAULT_NAME = "my_benchmark"
_SLOS = re.compile("^slos:", re.MULTILINE)


class _Template(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """The name of a template; an unknown name is reported with the known ones."""

    name = "template"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        from r2bspec.language.templates import templates

        if value not in templates():
            close = did_you_mean(value, templates())
            choices = f"templates: {', '.join(templates())}"
            hint = f"did you mean {close!r}? {choices}" if close else choices
            self.fail(f"unknown template {value!r}; {hint}", param, ctx)
        return value


@click.command("init")
@click.argument("name", default=_DEFAULT_NAME)
@click.option(
    "--template",
    type=_Template(),
    default="minimal",
    show_default=True,
    metavar="TEMPLATE",
    shell_complete=complete_template,
    help="The template; see --list.",
)
@click.option(
    "--node",
    default="",
    metavar="TARGET",
    help="The node under test: ./file.py:Class, module.Class, or "
    "PACKAGE:EXECUTABLE of a Python package; a main() in place of the class, too.",
)
@click.option(
    "--params-file",
    "parameter_file",
    default="",
    metavar="FILE",
    help="With --node: its parameters, as for 'ros2 run'; they can name its topics.",
)
@click.option(
    "--from-bag",
    "bag",
    default="",
    metavar="BAG",
    help="A recording or the name of a dataset: inputs, rates and window are proposed.",
)
@click.option(
    "--from-launch",
    "launch",
    default="",
    metavar="FILE|PACKAGE",
    help="The nodes of a launch file, which is executed with stand-ins if it is in Python, or the "
    "file as one node; a package, or PACKAGE:FILE.",
)
@options.repeatable_option(
    "--launch-arg",
    "launch_arguments",
    metavar="NAME:=VALUE",
    help="With --from-launch: the value of a launch argument, as for 'ros2 launch'",
)
@click.option(
    "--from-graph",
    "graph",
    is_flag=True,
    help="The nodes of the ROS graph that is running, with their topics, types and QoS.",
)
@click.option(
    "--probe",
    is_flag=True,
    help="With --node: start it once, if its source does not tell all its topics, and record them.",
)
@click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(min=1, max=600),
    default=10.0,
    show_default=True,
    help="With --from-graph and --probe: how many seconds to wait for the first node.",
)
@click.option("--list", "show_list", is_flag=True, help="List the templates.")
def init_command(
    name: str,
    template: str,
    node: str,
    parameter_file: str,
    bag: str,
    launch: str,
    launch_arguments: tuple[str, ...],
    graph: bool,
    probe: bool,
    timeout_s: float,
    show_list: bool,
) -> int:
    """Create a commented spec NAME.r2b.yaml that is valid as it is.

    NAME may start with an existing folder, as in benchmarks/camera. With --node, the spec has this
    node under its own name, and what its source tells: topics, or else calls. --from-bag,
    --from-launch, --from-graph and --node can be combined: the spec then has what they tell, and
    comments about what they do not. No file is overwritten.
    """
    from r2bspec.language.json_schema import FILE_NAME
    from r2bspec.language.templates import filled, purpose, templates, with_node

    if show_list:
        for metric_name, text in templates().items():
            echo(f"{metric_name:<14}{purpose(text)}")
        return ExitStatus.OK
    spec_file = Path(name.removesuffix(".r2b.yaml") + ".r2b.yaml")
    benchmark = _benchmark_name(spec_file.name.removesuffix(".r2b.yaml"))
    has_sources = bool(bag or launch or graph)
    if node:
        from r2bspec.authoring.sources import find_node

        node = find_node(node, spec_file.parent)
    _check_node(node, template)
    if (parameter_file or probe) and not node:
        raise click.UsageError(f"{'--probe' if probe else '--params-file'} needs --node")
    if has_sources and template != "minimal":
        raise click.UsageError("--template cannot be combined with --from-...")
    schema = f"./{FILE_NAME}" if spec_file.with_name(FILE_NAME).is_file() else ""
    chosen = click.get_current_context().get_parameter_source("template")
    is_default = chosen is click.core.ParameterSource.DEFAULT
    arguments = _launch_arguments(launch_arguments)

    def drafted() -> FirstSpec:
        from r2bspec.authoring import sources

        if node:
            sources.check_node_file(node, spec_file.parent)
        if not (has_sources or (node and (is_default or parameter_file))):
            text = with_node(templates()[template], node)
            return sources.FirstSpec(filled(text, benchmark, schema))
        given = sources.InitSources(bag, launch, arguments, graph, node, parameter_file, timeout_s)
        first = sources.spec_from_sources(benchmark, spec_file.parent, given)
        return replace(first, text=filled(first.text, None, schema))

    first = drafted()
    failed = 0
    if probe and first.lacks_topics:
        spec = _draft_spec(first.text, spec_file)
        key = next(key for key, each in spec.graph.nodes.items() if each.python == node)
        failed = _record(spec, spec_file.parent, (key,), timeout_s)
        first = drafted()
    _write_new({spec_file: first.text})
    print_findings("text", first.findings, {}, (), err=True)
    echo(f"created {spec_file}. Next:")
    if not probe and node and first.lacks_topics:
        echo(f"  rm {spec_file}, and this 'init' again with --probe, which starts {node}")
    echo(f"  r2bspec validate {spec_file}    checks it")
    judges = (
        "judges it by its 'slos:'" if _SLOS.search(first.text) else "judges nothing: add 'slos:'"
    )
    echo(f"  r2bspec run {spec_file}         runs it and {judges}")
    return ExitStatus.RUN_FAILED if failed else ExitStatus.OK


def _draft_spec(text: str, spec_file: Path) -> Spec:
    """Return a draft as it would be read.

    Raises:
        InvalidSpecError: a placeholder is not valid in it.
    """
    from r2bspec.api import InvalidSpecError
    from r2bspec.language.load_spec import load_spec

    loaded = load_spec(text, file=str(spec_file))
    if loaded.spec is None:
        raise InvalidSpecError(loaded, loaded.diagnostics)
    return loaded.spec


def _launch_arguments(written: tuple[str, ...]) -> dict[str, str]:
    """Launch arguments by name.

    Raises:
        UsageError: one is not written as ``NAME:=VALUE``.
    """
    pairs = [text.partition(":=") for text in written]
    for (name, sign, _), text in zip(pairs, written, strict=True):
        if not name or not sign:
            raise UsageError(
                f"{text!r} is no launch argument", hint="Write NAME:=VALUE, as for 'ros2 launch'."
            )
    return {name: value for name, _, value in pairs}


def _benchmark_name(name: str) -> str:
    """Return the name, if it is valid for a benchmark.

    Raises:
        UsageError: it is not.
    """
    from r2bspec.language.names import NAME

    if not re.search(NAME.pattern, name):
        better = re.sub(r"[^a-zA-Z0-9_]+", "_", name.removesuffix(".py")).strip("_")
        hint = NAME.message
        if re.search(NAME.pattern, better):
            hint += f"; for example {better}"
        if name.endswith(".py"):
            hint += "; for a spec of its node: --node ./FILE.py:CLASS"
        raise UsageError(f"{name!r} is not a valid name of a benchmark", hint=hint)
    return name


def _check_node(node: str, template: str) -> None:
    """Check that a target can be written into a template.

    Raises:
        UsageError: it is not a target of a Python node, or the template has none.
    """
    from r2bspec.language.names import PYTHON_NODE
    from r2bspec.language.templates import has_node, templates

    if node and (node.endswith(".py") or not re.search(PYTHON_NODE.pattern, node)):
        raise UsageError(f"{node!r} is not a Python node", hint=PYTHON_NODE.message)
    if node and not has_node(templates()[template]):
        names = ", ".join(name for name, text in templates().items() if has_node(text))
        raise UsageError(
            f"template {template!r} has no Python node of its own",
            hint=f"Use --node with one of these: {names}.",
        )


def _write_new(texts: Mapping[Path, str]) -> None:
    """Write files that do not exist yet: all of them, or none.

    Raises:
        UsageError: one exists, or cannot be written.
    """
    made: list[Path] = []
    try:
        for file, content in [(file, text.encode()) for file, text in texts.items()]:
            with file.open("xb") as stream:
                made.append(file)
                stream.write(content)
    except UnicodeEncodeError as error:
        near = quote(error.object[max(error.start - 20, 0) : error.end + 20])
        raise UsageError(
            f"{near} cannot be written into a spec: it is not UTF-8",
            hint="Rename the file or folder that the options name.",
        ) from error
    except OSError as error:
        for each in made:
            each.unlink(missing_ok=True)
        if isinstance(error, FileExistsError):
            hint = "Choose another name, or remove it first; nothing was written."
            raise UsageError(f"{file} already exists", hint=hint) from error
        raise UsageError(
            f"{file} cannot be written: {error.strerror or error}",
            hint="Create its folder first, or choose a shorter name in a folder of yours.",
        ) from error


_INTERFACE_HEAD = (
    "# Interface of the node {name}, recorded by 'r2bspec interfaces' for 'validate' and 'plan'.\n"
    "# Record it again when the node changes.\n"
)


@click.command(
    "interfaces", epilog=f"Exit status {ExitStatus.RUN_FAILED} if a node could not be inspected."
)
@options.spec_argument
@options.repeatable_option("--node", "only", metavar="KEY", help="Only this node")
@click.option(
    "--timeout",
    type=options.duration("1 s", "10 min"),
    default="20 s",
    show_default=True,
    help="The longest time for a node to appear.",
)
@options.spec_options
def interfaces_command(
    spec: Path,
    only: tuple[str, ...],
    timeout: Duration,
    values: SelectionValues,
) -> int:
    """Start each node of SPEC once, on real ROS 2, and record its interface.

    The topics, types, QoS profiles, services and parameters of a node are written to
    'interfaces/KEY.yaml' next to SPEC, where every other verb finds them. Launch files and external
    nodes are left out.
    """
    from r2bspec.api import InvalidSpecError, load

    try:
        loaded = load(spec, **values)
    except InvalidSpecError as error:
        show_findings(error.diagnostics, error.loaded)
        raise
    nodes = {**loaded.preprocessors, **loaded.graph.nodes}
    for name in only:
        if name not in nodes:
            close = did_you_mean(name, nodes)
            hint = f"; did you mean {close!r}?" if close else f"; nodes: {', '.join(nodes)}"
            raise click.UsageError(f"the spec has no node {name!r}{hint}")
    failed = _record(loaded, spec.parent, only, timeout.seconds)
    return ExitStatus.RUN_FAILED if failed else ExitStatus.OK


def _record(spec: Spec, folder: Path, only: tuple[str, ...], timeout_s: float) -> int:
    """Start nodes, and write their interfaces; return how many could not be inspected."""
    from r2bspec.introspect import record_interfaces

    failed = 0
    for node, found in record_interfaces(
        spec,
        folder,
        only=only,
        timeout_s=timeout_s,
        on_node=lambda name: echo(f"starting {name}", err=True),
    ):
        if isinstance(found, R2bspecError):
            failed += 1
            echo(f"error: {message_text(f'{node}: {found}')}", err=True, lines=True)
            if found.hint:
                echo(f"  help: {found.hint}", err=True)
        else:
            echo(_write_interface(folder, node, found))
    return failed


def _write_interface(folder: Path, name: str, interface: dict[str, Any]) -> str:
    """Write a node's file atomically; returns its path as the user would write it."""
    from r2bspec.language.yaml_document import to_yaml
    from r2bspec.plan.wiring.companion_files import interface_file
    from r2bspec.record.files import write_atomically

    file = interface_file(folder, name)
    file.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(file, (_INTERFACE_HEAD.format(name=name) + to_yaml(interface)).encode())
    return str(file)
