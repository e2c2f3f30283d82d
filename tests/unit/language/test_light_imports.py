"""What takes long to import is imported where it is needed, and not before."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

GOLDEN = Path(__file__).parents[2] / "golden" / "language"
ROS = ("rclpy", "cv2", "numpy")
LIBRARIES = (*ROS, "scipy", "rosbags", "rich")
EXPLAINERS = ("jsonschema", "r2bspec.language.explain_violations")
LOAD = "from pathlib import Path; from r2bspec.language.load_spec import load_spec; load_spec(Path"


@pytest.mark.parametrize(
    ("code", "heavy"),
    [
        (f"{LOAD}('{GOLDEN}/ok_full.yaml'))", LIBRARIES),
        (f"{LOAD}('{GOLDEN}/ok_everything.yaml'), environ={{'R2B_TEST_COUNT': '7'}})", EXPLAINERS),
        (
            f"from r2bspec.cli.main import main; main(['validate', '{GOLDEN}/ok_minimal.yaml'])",
            LIBRARIES,
        ),
        ("import r2bspec.doctor.all_checks", ROS),
        ("import r2bspec.nodes; dir(r2bspec.nodes)", ROS),
    ],
    ids=["load", "load without mistakes", "validate", "doctor", "nodes"],
)
def test_nothing_heavy_is_imported(code: str, heavy: tuple[str, ...]) -> None:
    program = f"import sys; {code}; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "[]"
