"""How large a simulation is: a small seeded sample by default, the whole one where it is asked for.

``R2BSPEC_NIGHTLY=1 pytest tests/simulation`` runs the whole of all simulations.
"""

from __future__ import annotations

import os


def size(sample: int, whole: int) -> int:
    """The number of simulated runs, or of whatever else a test repeats.

    Args:
        sample: as many as take seconds.
        whole: with which the stated errors are known to a fraction of themselves.
    """
    return whole if os.environ.get("R2BSPEC_NIGHTLY", "") not in {"", "0"} else sample


def noise(share: float) -> float:
    """What a small sample may add to a share by chance; nothing in the whole simulation."""
    return share if size(1, 0) else 0.0
