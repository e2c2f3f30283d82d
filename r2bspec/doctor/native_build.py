"""Whether the native player and monitor can be built here: compiler and headers."""

from __future__ import annotations

from r2bspec.doctor.checkup import CheckResult, System
from r2bspec.native.errors import BuildError
from r2bspec.native.harness_library import harness_program

TOPIC = "native harness"


def check_native(system: System) -> list[CheckResult]:
    """Build the program, unless it has been; takes a second."""
    try:
        program = harness_program(system.environ)
    except BuildError as error:
        found = str(error).splitlines()[0]
        return [
            CheckResult(topic=TOPIC, name="build", status="problem", found=found, advice=error.hint)
        ]
    data = {"program": str(program)}
    return [CheckResult(topic=TOPIC, name="build", status="ok", found=str(program), data=data)]
