"""What a host finds wrong with a spec before it is run there: packages and recordings it lacks."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import msgspec

from r2bspec.bags.integrity import hash_files
from r2bspec.exit_status import ExitStatus
from r2bspec.fleet.bundle import needs_of
from r2bspec.fleet.errors import TransferError
from r2bspec.fleet.host_messages import Job, Problem, Side
from r2bspec.fleet.host_store import inside
from r2bspec.plan.canonical_json import parse_plan

_VALIDATE_S: Final = 300.0
_VALID_S: Final = 600.0
"""For so long a spec without errors is not checked again: a suite offers it twice, and often."""


def other_recordings(job: Job) -> Iterator[Problem]:
    """Recordings that a job names by absolute paths, and that are not there, or are others."""
    for recording in job.recordings:
        place = Path(recording.path)
        if recording.absolute and (not place.exists() or hash_files(place) != recording.sha256):
            yield Problem(
                code="R2B301",
                message=f"{recording.path} is not on this host, or is another recording",
                hint="Name recordings relative to the spec or by $R2B_DATASETS: they are sent.",
                exit_status=ExitStatus.USAGE,
            )


class HostValidation:
    """Runs ``r2bspec validate`` on specs as they come, and remembers those without errors."""

    def __init__(self, host: str, environment: Mapping[str, str]) -> None:
        """Begin.

        Args:
            host: the name of this host, for messages.
            environment: of the process that validates, which is that of runs.
        """
        self._host = host
        self._environment = dict(environment)
        self._valid: dict[str, float] = {}

    def problems(self, job: Job, side: Side, tree: Path) -> Iterator[Problem]:
        """The errors of a spec, found in a process that sees what is installed now.

        Raises:
            TransferError: the process failed.
        """
        name = needs_of(parse_plan(side.plan.encode(), "the plan of the client"), job.bundle)
        if time.monotonic() - self._valid.get(name, -_VALID_S) < _VALID_S:
            return
        folder = tree if side.base_dir == "." else inside(tree, side.base_dir)
        found = self._validate(folder / f".{name[:16]}.r2b.yaml", side.spec_text)
        if not found.errors:
            self._valid[name] = time.monotonic()
        for each in found.findings:
            # Those about objectives do not concern a smoke run, as for one that is not sent.
            if each.severity == "error" and not (job.smoke and each.code.startswith("R2B5")):
                yield Problem(
                    code=each.code,
                    message=each.message,
                    hint=each.help or "",
                    exit_status=ExitStatus.USAGE,
                )

    def _validate(self, file: Path, spec_text: str) -> _Findings:
        file.write_text(spec_text)
        try:
            done = subprocess.run(
                [sys.executable, "-P", "-m", "r2bspec", "validate", "--format", "json", str(file)],
                stdin=subprocess.DEVNULL,
                capture_output=True,
                env=self._environment,
                timeout=_VALIDATE_S,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise TransferError(f"validate does not end on the host {self._host}") from error
        finally:
            file.unlink(missing_ok=True)
        try:
            return msgspec.json.decode(done.stdout, type=_Findings)
        except msgspec.MsgspecError as error:
            text = done.stderr.decode(errors="replace").strip()
            raise TransferError(f"validate failed on the host {self._host}: {text}") from error


class _Found(msgspec.Struct):
    code: str
    severity: str
    message: str
    help: str | None = None


class _Findings(msgspec.Struct):
    errors: int
    findings: list[_Found]
