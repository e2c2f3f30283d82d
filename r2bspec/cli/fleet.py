"""``r2bspec fleet``: hosts that run benchmarks for others, and what they do."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec

from r2bspec.cli import shared_options as options
from r2bspec.cli.text_output import print_table
from r2bspec.errors import ExitStatus
from r2bspec.language.quantities import Size, parse_size_option
from r2bspec.report.output import echo, echo_json

if TYPE_CHECKING:
    from r2bspec.fleet.hosts import Host

_EARLIER_RUN_S = 30.0
"""For so long the run of a worker that was killed may take to end."""


@click.group("fleet")
def command() -> None:
    """Run benchmarks on several machines.

    The scheduler is that of Dask: on one machine, start it with 'dask scheduler --host 127.0.0.1
    --dashboard-address 127.0.0.1:8787'. Each machine runs a worker, and 'r2bspec run SPECS --on
    ADDRESS' plays benchmarks on them.
    """


@command.command("worker")
@click.argument("scheduler")
@click.option("--name", default="", help="The name of this host.  [default: its host name]")
@options.repeatable_option(
    "--label",
    "labels",
    metavar="NAME=VALUE",
    help="A label of this host, such as robot=carter",
)
@click.option(
    "--folder",
    type=options.FOLDER,
    help="Where recordings and runs are kept.  [default: the cache folder of the user]",
)
@click.option(
    "--cache-limit",
    default="20 GiB",
    show_default=True,
    metavar="SIZE",
    help="The most that is kept.",
)
@options.repeatable_option(
    "--recordings",
    "shared",
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    help="A folder of recordings that several hosts reach",
)
@options.flag_options(
    {
        "--allow-commands": "Run commands and setup steps that specs bring along.",
        "--allow-python": "Run Python and launch files that specs bring along.",
    }
)
@click.option(
    "--listen",
    default="",
    metavar="ADDRESS",
    help="Listen at this address only; without TLS it must be of the loopback interface.",
)
@click.option("--no-doctor", is_flag=True, help="Do not check this machine first.")
@options.connection_options
def worker(
    scheduler: str,
    name: str,
    labels: tuple[str, ...],
    folder: Path | None,
    cache_limit: str,
    shared: tuple[Path, ...],
    allow_commands: bool,
    allow_python: bool,
    listen: str,
    no_doctor: bool,
    connection: dict[str, Any],
) -> int:
    """Let this machine run benchmarks for the fleet of SCHEDULER, an address or a cluster file.

    The worker ends with Ctrl-C, and connects again by itself when the scheduler was restarted.
    """
    from r2bspec.fleet.security import fleet_address, listen_address, require_distributed

    require_distributed()
    from r2bspec.fleet.host_service import HostService
    from r2bspec.fleet.host_store import SCRATCH, HostStore
    from r2bspec.fleet.hosts import HostName, describe_host
    from r2bspec.fleet.permissions import COMMANDS, PYTHON
    from r2bspec.fleet.worker import WorkerSettings, run_worker
    from r2bspec.safe_io.cache_folder import believed_folder, cache_or_temporary_folder
    from r2bspec.safe_io.private_files import private_files

    _check_installation()
    address = fleet_address(scheduler, **connection)
    listen = listen_address(address, listen)
    try:
        limit_bytes = parse_size_option(cache_limit)
    except ValueError as error:
        raise click.UsageError(f"--cache-limit: {error}") from error
    try:
        root = believed_folder(folder) if folder else cache_or_temporary_folder("fleet")
    except OSError as error:
        raise click.UsageError(f"--folder {folder}: {error.strerror or error}") from error
    allows = (*([COMMANDS] if allow_commands else []), *([PYTHON] if allow_python else []))
    facts = describe_host(
        name, options.parse_pairs("--label", labels), allows=allows, doctor=not no_doctor
    )
    try:
        msgspec.convert(facts.name, HostName)
    except msgspec.ValidationError as error:
        raise click.UsageError("--name: no comma, slash, or dot at its beginning") from error
    store = HostStore(root, limit_bytes, shared)
    with private_files(), store.locked(_EARLIER_RUN_S) as lock:
        if lock is None:
            raise click.UsageError(f"another worker uses {store.root}: name another --folder")
        service = HostService(facts, store, lock)
        service.remove_unfinished()
        settings = WorkerSettings(address=address, scratch=store.root / SCRATCH, listen=listen)
        run_worker(service, settings, lambda text: echo(text, err=True))
    return ExitStatus.OK


def _check_installation() -> None:
    """See that runs find r2bspec, which they do not look for in the folder of the user."""
    import site

    if Path(__file__).is_relative_to(site.getusersitepackages()):
        raise click.UsageError(
            "r2bspec is installed for this user alone, in a folder that specs may write to: "
            "install it in a virtual environment, and start the worker from there"
        )


@command.command("hosts")
@click.argument("scheduler")
@options.format_option()
@options.connection_options
def hosts(scheduler: str, output_format: str, connection: dict[str, Any]) -> int:
    """Show the hosts of a fleet: machine, software, labels, and what 'doctor' warns of there."""
    all_facts = [host.facts for host in _hosts_of(scheduler, connection)]
    if output_format == "json":
        echo_json({"r2bspec_hosts": 1, "hosts": all_facts})
        return ExitStatus.OK
    rows = [
        (
            facts.name,
            facts.arch,
            f"{facts.cores} x {facts.cpu}",
            str(Size(facts.memory_bytes // 2**20 * 2**20)),
            ", ".join(facts.gpus),
            facts.ros_distro,
            facts.r2bspec,
            " ".join(f"{name}={value}" for name, value in facts.labels.items()),
            " ".join(facts.allows),
        )
        for facts in all_facts
    ]
    header = ("host", "arch", "CPU", "memory", "GPU", "ROS", "r2bspec", "labels", "allows")
    print_table(header, rows, right_columns=range(1, len(header)))
    for facts in all_facts:
        for name, what in facts.doctor.items():
            echo(f"{facts.name}: {name}: {what}")
    return ExitStatus.OK


@command.command("status")
@click.argument("scheduler")
@options.format_option()
@options.connection_options
def status(scheduler: str, output_format: str, connection: dict[str, Any]) -> int:
    """Show what every host of a fleet does now, and when it was last heard of."""
    hosts = _hosts_of(scheduler, connection)
    if output_format == "json":
        states = [
            {"host": host.name, "seen_s": host.seen_s, **msgspec.structs.asdict(host.state)}
            for host in hosts
        ]
        echo_json({"r2bspec_fleet": 1, "hosts": states})
        return ExitStatus.OK
    rows = [
        (
            host.name,
            *(host.state.state, host.state.name, host.state.phase),
            *host.figures,
            f"{host.seen_s:.0f} s ago",
        )
        for host in hosts
    ]
    header = ("host", "state", "benchmark", "phase", "left", "p99", "heard of")
    print_table(header, rows, right_columns=range(1, len(header)))
    return ExitStatus.OK


@command.command("certificates")
@click.argument("folder", type=options.FOLDER)
@options.repeatable_option(
    "--host",
    "names",
    help="A host name or an address for the certificates",
)
def certificates(folder: Path, names: tuple[str, ...]) -> int:
    """Make an authority in FOLDER, and certificates for scheduler, workers and clients."""
    from r2bspec.fleet.security import make_certificates

    for certificate in make_certificates(folder, names):
        echo(str(certificate))
    return ExitStatus.OK


def _hosts_of(scheduler: str, connection: dict[str, Any]) -> list[Host]:
    from r2bspec.fleet.client import FleetClient
    from r2bspec.fleet.security import fleet_address

    with FleetClient(fleet_address(scheduler, **connection)) as client:
        return [host for _, host in sorted(client.hosts.items())]
