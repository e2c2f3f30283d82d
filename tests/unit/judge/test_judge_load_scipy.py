"""SciPy is imported ahead of its first use, so that no probe is disturbed by the import."""

from __future__ import annotations

import subprocess
import sys

_PROGRAM = """
import sys
import numpy as np
from r2bspec.judge.rate_decision import load_scipy
assert not any(name.startswith("scipy") for name in sys.modules)
load_scipy().join()
known = {name for name in sys.modules if name.startswith("scipy")}
assert "scipy.special" in known
from r2bspec.judge.statistics.binomial import upper_bound
from r2bspec.judge.statistics.trend import trend
upper_bound(1, 100, 0.95)
trend(np.arange(50.0), np.random.default_rng(1).normal(size=50), 0.95)
new = {name for name in sys.modules if name.startswith("scipy")} - known
print("imported later:", sorted(new))
"""


def test_statistics_import_nothing_of_scipy_after_that() -> None:
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM], capture_output=True, text=True, check=False
    )
    assert done.stdout == "imported later: []\n", done.stderr
