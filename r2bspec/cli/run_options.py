"""The options of ``r2bspec run`` apart from those of a spec, and which of them go together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from r2bspec.report.write_reports import ReportRequest

ALL_CASES = "all"
"""The value of ``--case`` that selects every case of a matrix."""


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """The options as they were given; the names are those of the command line.

    Attributes:
        known_names: names of `allow` that are known to some spec of a suite.
        suite_page: the HTML page of the suite that a run belongs to, to which its own pages link.
    """

    output: Path | None = None
    against: tuple[str, ...] = ()
    allow: tuple[str, ...] = ()
    known_names: tuple[str, ...] = ()
    base_build: tuple[str, ...] = ()
    base_setup: str = ""
    control: bool = False
    pairs: int | None = None
    history: str | None = None
    baseline: Path | None = None
    force: bool = False
    require_slos: bool = False
    each: bool = False
    select: tuple[str, ...] = ()
    scan: tuple[str, ...] = ()
    smoke: bool = False
    resume: bool = False
    fail_fast: bool = False
    abort_on_fail: bool = False
    record_outputs: bool = False
    profile: str | None = None
    profile_node: str | None = None
    timings: bool = False
    no_wait: bool = False
    no_lock: bool = False
    on: str | None = None
    hosts: tuple[str, ...] = ("all",)
    connection: Mapping[str, Any] = field(default_factory=dict)
    host_timeout: float = 600.0
    retry_invalid: int = 1
    output_format: str = "text"
    quiet: bool = False
    verbose: bool = False
    suite_page: Path | None = None
    reports: tuple[ReportRequest, ...] = ()

    @property
    def compares(self) -> bool:
        """Whether interleaved pairs are run."""
        return bool(self.against) or self.control

    @property
    def has_base_tree(self) -> bool:
        """Whether the base has a work tree of its own: a revision of git, or a folder.

        Raises:
            BadReferenceError: the base is not valid.
        """
        if not self.against:
            return False
        from r2bspec.compare.base_reference import parse_base_reference

        return parse_base_reference(self.against).has_tree

    @property
    def needs_suite(self) -> bool:
        """Whether an option only makes sense for several runs."""
        return bool(self.select or self.scan or self.resume or self.fail_fast or self.each)

    def check(self) -> None:
        """Report options that exclude each other, or need another one.

        Raises:
            click.UsageError: there are some.
        """
        if self.against and self.control:
            raise click.UsageError(
                "--control cannot be combined with --against: it compares SPEC with itself"
            )
        for_fleet = {
            "--hosts": self.hosts != ("all",),
            **{f"--{name}": bool(value) for name, value in self.connection.items()},
        }
        if self.on is None and any(for_fleet.values()):
            name = next(name for name, given in for_fleet.items() if given)
            raise click.UsageError(f"{name} needs --on")
        comparisons = {
            "--against": bool(self.against),
            "--control": self.control,
            "--history": self.history is not None,
            "--baseline": self.baseline is not None,
        }
        used_options = [name for name, given in comparisons.items() if given]
        if len(used_options) > 1:
            raise click.UsageError(
                f"{' and '.join(used_options)} cannot be combined: choose one comparison"
            )
        if self.smoke and used_options:
            raise click.UsageError(
                f"--smoke cannot be combined with {used_options[0]}: it judges nothing"
            )
        if self.smoke and self.require_slos:
            raise click.UsageError(
                "--smoke cannot be combined with --require-slos: it judges nothing"
            )
        if self.abort_on_fail and self.compares:
            raise click.UsageError("--abort-on-fail cannot be combined with --against or --control")
        if self.record_outputs and self.compares:
            raise click.UsageError(
                "--record-outputs cannot be combined with --against or --control"
            )
        if self.profile is not None and self.compares:
            raise click.UsageError("--profile cannot be combined with --against or --control")
        if self.timings and (self.compares or self.needs_suite or self.on is not None):
            raise click.UsageError(
                "--timings is of one run on this host; 'phases' in each record.json has the times"
            )
        if self.profile_node is not None and self.profile is None:
            raise click.UsageError("--profile-node needs --profile")
        of_gate = {
            "--allow": self.allow,
            "--base-build": self.base_build,
            "--base-setup": self.base_setup,
        }
        given = [name for name, value in of_gate.items() if value]
        if given and not self.has_base_tree:
            raise click.UsageError(f"{given[0]} needs --against with a revision or a work tree")
        if self.force and not (self.against or self.baseline is not None):
            raise click.UsageError("--force needs --against or --baseline")

    def check_pairs(self) -> None:
        """Report ``--pairs`` without a comparison.

        Raises:
            click.UsageError: there is none.
        """
        if self.pairs is not None and not self.compares:
            raise click.UsageError("--pairs needs --against or --control")

    def check_fleet(self) -> None:
        """Report options that do not go with ``--on``.

        Raises:
            click.UsageError: there are some.
        """
        without = {
            "--baseline": self.baseline is not None,
            "--no-lock": self.no_lock,
            "--no-wait": self.no_wait,
            "--against with a revision or a work tree": self.has_base_tree,
        }
        for name, given in without.items():
            if given:
                raise click.UsageError(f"{name} cannot be combined with --on")
        if self.resume and self.output is None:
            raise click.UsageError("--resume needs the --output of the earlier call")

    def check_suite(self) -> None:
        """Report options that are for a single run.

        Raises:
            click.UsageError: there are some.
        """
        if (self.compares and not self.has_base_tree) or self.baseline is not None:
            raise click.UsageError(
                "--against with another spec, value or environment, --control and --baseline take "
                "one SPEC, without --case all, --select, --scan, --resume, --fail-fast and --each"
            )
        if self.compares and (self.resume or self.scan):
            raise click.UsageError("--against cannot be combined with --resume and --scan")
        if self.resume and self.output is None:
            raise click.UsageError("--resume needs the --output of the earlier call")
