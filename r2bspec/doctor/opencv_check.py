"""OpenCV, which the reference nodes for images use."""

from __future__ import annotations

from r2bspec.doctor.checkup import CheckResult, System
from r2bspec.doctor.import_check import probe_imports

TOPIC = "OpenCV"


def check_vision(system: System) -> list[CheckResult]:
    """Check whether it can be imported. Other nodes than the reference nodes may not need it."""
    found = probe_imports(system, "cv2")["cv2"]
    if "error" in found:
        return [
            CheckResult(
                topic=TOPIC,
                name="version",
                status="warn",
                found=found["error"],
                advice="the reference nodes for images need it: pip install 'r2bspec[vision]'",
            )
        ]
    return [
        CheckResult(topic=TOPIC, name="version", status="ok", found=found["version"], data=found),
    ]
