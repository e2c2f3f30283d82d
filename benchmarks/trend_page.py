"""What `r2bspec trend` costs: pages of 100 and of 1,000 results of 20 metrics.

``python benchmarks/trend_page.py`` prints the figures of docs/performance.md: the processor
time, to which other programs add little.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests/support"))

from validate_speed import cpu_s

from histories import noisy, some_result, write_history
from r2bspec.compare.history import read_histories


def main() -> None:
    """Measure and print the table."""
    sys.stdout.write("| results | metrics | page | processor time |\n| --- | --- | --- | --- |\n")
    for number in (100, 1000):
        with tempfile.TemporaryDirectory() as name:
            folder, page = Path(name), Path(name) / "trend.html"
            result = some_result(folder / "run", (10, 30))
            factors = noisy(number, {int(number * 0.4): 1.1, int(number * 0.8): 1.3})
            write_history(folder / "results", result, factors)
            (history,), _ = read_histories([folder / "results"])
            results = str(folder / "results")
            command = [sys.executable, "-m", "r2bspec", "trend", results, f"--report=html={page}"]
            taken = cpu_s(command, folder)
            size = page.stat().st_size / 1e6
            sys.stdout.write(
                f"| {number:,} | {len(history.metrics)} | {size:.2f} MB | {taken:.1f} s |\n"
            )


if __name__ == "__main__":
    main()
