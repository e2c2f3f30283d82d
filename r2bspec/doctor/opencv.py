"""OpenCV, which the reference nodes for images use."""

from __future__ import annotations

from r2bspec.doctor.checkup import Check, System
from r2bspec.doctor.import_check import imports

TOPIC = "OpenCV"


def check_vision(system: System) -> list[Check]:
    """Whether it can be imported. A graph of one's own needs it only if its nodes do."""
    found = imports(system, "cv2")["cv2"]
    if "error" in found:
        return [
            Check(
                topic=TOPIC,
                name="version",
                status="warn",
                found=found["error"],
                advice="the reference nodes for images need it; pip install 'r2bspec[vision]'",
            )
        ]
    return [
        Check(topic=TOPIC, name="version", status="ok", found=found["version"], data=found),
    ]
