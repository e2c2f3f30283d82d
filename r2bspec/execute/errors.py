"""Errors of a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.record.files import RUN_UNWRITABLE
from r2bspec.record.run_record import Difference

_CERTAIN_CODES = frozenset({"R2B633", "R2B644", "R2B658", "R2B681"})
"""The codes of faults of the input or the installation, which another attempt would not mend: a
constructor that raises, recordings that do not fit together, missing message types."""


class RunError(R2bspecError):
    """The run failed; its measurements are kept.

    It can be repeated, unless its code says that another attempt would end in the same way.

    Attributes:
        blamed: the process of the plan, or the full name of the node, that it is about; else empty.
    """

    code = "R2B630"
    exit_code = ExitStatus.RUN_FAILED
    way_out = "Look into the logs of the run folder, and run again."
    status: ClassVar[Literal["incomplete", "invalid"]] = "incomplete"
    """That of the record of the run."""

    def __init__(
        self, message: str, *, hint: str = "", code: str | None = None, blamed: str = ""
    ) -> None:
        super().__init__(message, hint=hint, code=code)
        self.blamed = blamed
        if self.code in _CERTAIN_CODES:
            self.exit_code = ExitStatus.USAGE


class CertainRunError(RunError):
    """The run failed, and another attempt would fail in the same way."""

    exit_code = ExitStatus.USAGE


class NotInstalledError(CertainRunError):
    """Something that the plan needs is not installed on this machine."""

    code = "R2B620"


class ProcessDiedError(RunError):
    """A process exited before it was stopped.

    Attributes:
        process: its name; empty where it was said what else this means.
        output: its last output.
    """

    code = "R2B631"

    def __init__(
        self, message: str, *, hint: str = "", process: str = "", output: str = ""
    ) -> None:
        super().__init__(message, hint=hint, blamed=process)
        self.process = process
        self.output = output

    def while_doing(self, what: str, node: str) -> ProcessDiedError:
        """Return the same error, with the step and the node that the process was busy with."""
        error = ProcessDiedError(f"{what}: {self}", hint=self.hint)
        error.blamed = node
        return error


class ProcessFailedError(RunError):
    """A process reported an error."""


class NotReadyError(RunError):
    """The graph was not ready, as planned, within its timeout."""

    code = "R2B640"


class GraphDifferencesError(CertainRunError):
    """The running graph differs from the spec; another attempt would not help.

    Attributes:
        differences: at least one.
        details: what there is to say apart from the differences; may be empty.
    """

    def __init__(
        self,
        differences: Sequence[Difference],
        message: str = "",
        hint: str = "",
        *,
        details: str = "",
    ) -> None:
        """Take message and hint from the differences where they are empty."""
        message = message or "; ".join(difference.message for difference in differences)
        super().__init__(message, hint=hint or differences[0].help, code=differences[0].code)
        self.differences = tuple(differences)
        self.details = details


class NoOutputError(RunError):
    """All endpoints are matched, but there is no output."""

    code = "R2B641"


class DeadInputError(NoOutputError):
    """No subscription receives the played messages any more: the graph was not tested."""

    status = "invalid"


class InterruptedRunError(RunError):
    """A signal of the user or the system interrupted the run."""

    code = "R2B670"
    exit_code = ExitStatus.INTERRUPTED


class StepFailedError(RunError):
    """A `setup` or `after_ready` step failed."""

    code = "R2B648"


class NotJoinableError(CertainRunError):
    """Player and monitors cannot run in a process of the graph; another attempt would not help."""

    code = "R2B674"


class MiddlewareError(CertainRunError):
    """The plan asks for something that the selected middleware (RMW) cannot be configured for."""

    code = "R2B666"


class UnwritableRunError(RunError):
    """The run cannot write its files."""

    code = RUN_UNWRITABLE


class WorkspaceError(CertainRunError):
    """The environment of a run does not exist, or cannot be sourced."""

    code = "R2B657"
    way_out = "Give a setup.bash, local_setup.bash or setup.sh that bash can source."
