"""What can go wrong with a run. Each is a `RunError`: the run failed, not the input."""

from __future__ import annotations

from collections.abc import Sequence

from r2bspec.errors import R2bspecError
from r2bspec.record.errors import RUN_UNWRITABLE
from r2bspec.record.run_record import Difference


class RunError(R2bspecError):
    """The run itself failed; what it had observed is kept. Safe to try again."""

    code = "R2B630"
    exit_code = 4


class NotInstalledError(RunError):
    """Something that the plan needs is not installed on this machine."""

    code = "R2B620"
    exit_code = 2


class DatasetMismatchError(RunError):
    """The bag is not the one that the spec pins."""

    code = "R2B312"
    exit_code = 2


class ProcessDiedError(RunError):
    """A process ended although nobody had told it to."""

    code = "R2B631"


class ProcessFailedError(RunError):
    """A process said why it could not go on."""

    code = "R2B630"


class NotReadyError(RunError):
    """The graph did not come up as planned within the time allowed."""

    code = "R2B640"


class GraphMismatchError(RunError):
    """The real graph is not the one of the spec: to try again would not help.

    Attributes:
        differences: in what; at least one.
    """

    exit_code = 2

    def __init__(self, differences: Sequence[Difference], message: str, hint: str = "") -> None:
        super().__init__(message, hint=hint, code=differences[0].code)
        self.differences = tuple(differences)


class NoOutputError(RunError):
    """The graph stands but nothing comes out."""

    code = "R2B641"


class InterruptedRunError(RunError):
    """The user or the system asked for an end."""

    code = "R2B670"
    exit_code = 130


class StepFailedError(RunError):
    """A setup step, or a step once the graph stood, did not do what it should."""

    code = "R2B648"


class UnsupportedError(RunError):
    """The plan asks for something that this version does not carry out."""

    code = "R2B619"
    exit_code = 2


class SecretNotSetError(RunError):
    """The plan refers to a secret that is not in the environment."""

    code = "R2B122"
    exit_code = 2


class SharedMemoryError(RunError):
    """There is less shared memory than the transport of the plan needs."""

    code = "R2B664"
    exit_code = 2


class MemoryLimitError(RunError):
    """A process uses more memory than the spec allows it."""

    code = "R2B635"


class UnwritableRunError(RunError):
    """The file system refuses in mid-run what the run has to write."""

    code = RUN_UNWRITABLE


class WorkspaceError(RunError):
    """The environment that a run should be made in is not there, or cannot be sourced."""

    code = "R2B657"
    exit_code = 2
