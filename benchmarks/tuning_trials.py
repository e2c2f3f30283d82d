"""How many trials `r2bspec tune` needs for a deployment as good as the best.

    PYTHONPATH=tests/support:tests/simulation python benchmarks/tuning_trials.py [--graphs 100]

The graphs are simulated, so that the best deployment of each is known; the search, chance and a
grid of all combinations try them until one keeps the limit and costs less than 5 % more. The table
in docs/tuning.md is from it.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from simulated_deployments import trials_needed


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--graphs", type=int, default=100)
    needed = [each for seed in range(parser.parse_args().graphs) if (each := trials_needed(seed))]
    lines = [f"| trials, {len(needed)} graphs | median | 90 % of graphs |", "| --- | --- | --- |"]
    for name in needed[0]:
        half, most = np.percentile([each[name] for each in needed], (50, 90))
        lines.append(f"| {name} | {half:.0f} | {most:.0f} |")
    sys.stdout.write("\n".join([*lines, ""]))


if __name__ == "__main__":
    main()
