"""``r2bspec interfaces``: start each node once and record its topics, services and parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from r2bspec.cli.quantity_options import duration
from r2bspec.cli.shared_options import SpecValues, spec_options
from r2bspec.exit_status import ExitStatus
from r2bspec.language.quantities import Duration
from r2bspec.report.output import echo

_HEAD = (
    "# Interface of the node {name}, recorded by 'r2bspec interfaces' for 'validate' and 'plan'.\n"
    "# Record it again when the node changes.\n"
)


@click.command(
    "interfaces", epilog=f"Exit status {ExitStatus.RUN_FAILED} if a node could not be inspected."
)
@click.argument("spec", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--node", "only", multiple=True, metavar="KEY", help="Only this node; may be repeated."
)
@click.option(
    "--timeout",
    type=duration("1 s", "10 min"),
    default="20 s",
    show_default=True,
    help="The longest time for a node to appear.",
)
@spec_options
def command(
    spec: Path,
    only: tuple[str, ...],
    timeout: Duration,
    values: SpecValues,
) -> int:
    """Start each node of SPEC once, on real ROS 2, and record its interface.

    The topics, types, QoS profiles, services and parameters of a node are written to
    'interfaces/KEY.yaml' next to SPEC, where every other verb finds them. Launch files and external
    nodes are left out.
    """
    from r2bspec.api import InvalidSpecError, load
    from r2bspec.diagnostics import did_you_mean
    from r2bspec.introspect import record_interfaces
    from r2bspec.report.findings_text import print_findings as show

    try:
        loaded = load(spec, **values._asdict())
    except InvalidSpecError as error:
        show(error.diagnostics, error.loaded.texts)
        raise
    known = {**loaded.preprocessors, **loaded.graph.nodes}
    for each in only:
        if each not in known:
            close = did_you_mean(each, known)
            hint = f"; did you mean {close!r}?" if close else f"; nodes: {', '.join(known)}"
            raise click.UsageError(f"the spec has no node {each!r}{hint}")
    failed = 0
    for found in record_interfaces(
        loaded,
        spec.parent,
        only=only,
        timeout_s=timeout.seconds,
        on_node=lambda name: echo(f"starting {name}", err=True),
    ):
        if found.interface is None:
            failed += 1
            echo(f"error: {found.node}: {found.problem}", err=True)
            if found.hint:
                echo(f"  help: {found.hint}", err=True)
            continue
        echo(_write(spec.parent, found.node, found.interface))
    return ExitStatus.RUN_FAILED if failed else ExitStatus.OK


def _write(folder: Path, name: str, interface: dict[str, Any]) -> str:
    """Write a node's file atomically; returns its path as the user would write it."""
    from r2bspec.language.yaml_document import to_yaml
    from r2bspec.record.files import write_atomically
    from r2bspec.wiring.companion_files import interface_file

    file = interface_file(folder, name)
    file.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(file, (_HEAD.format(name=name) + to_yaml(interface)).encode())
    return str(file)
