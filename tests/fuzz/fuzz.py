"""Coverage-guided fuzzing of every reader: ``make fuzz``.

::

    python tests/fuzz/fuzz.py --seconds 60 [READER...]

Inputs that reach new code are kept in ``.fuzz``, where the next call begins with them. One that is
not answered cleanly (`readers`) is written to ``tests/fuzz/corpus``, which the unit tests play:
commit it with the repair. Each target is a process of its own, two at a time.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import random
import re
import resource
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import atheris

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests/support"), str(ROOT / "tests/fuzz")]
sys.dont_write_bytecode = True

AT_A_TIME = 2
LONGEST_S = 60
"""After which an input is taken for one that never ends."""

MOST_MEMORY_BYTES = 4 << 30
LONGEST_INPUT_BYTES = 1 << 16
_OF_BYTES = 0.25
"""The share of changes that know nothing of the structure."""

# Also of what the readers import later: never left.
_instrumented = atheris.instrument_imports(
    include=["r2bspec", "rosbags"], enable_loader_override=False
)


def fuzz(name: str, seconds: int) -> None:
    """Fuzz one reader in this process, which ends here."""
    _instrumented.__enter__()
    from readers import CORPUS, READERS, read

    reader = READERS[name]
    reader.prepare()
    # Not before: a program with the address sanitizer reserves more.
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY_BYTES, MOST_MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    kept, corpus = ROOT / ".fuzz" / name, CORPUS / name
    for folder in (kept, corpus):
        folder.mkdir(parents=True, exist_ok=True)
    for seed in reader.seeds():
        (kept / hashlib.sha1(seed).hexdigest()).write_bytes(seed)  # noqa: S324 - as libFuzzer

    def mutate(data: bytes, most_bytes: int, seed: int) -> bytes:
        rng = random.Random(seed)  # noqa: S311 - nothing is secret
        if rng.random() > _OF_BYTES:
            try:
                changed = reader.mutate(data, rng)
            except Exception:
                return bytes(atheris.Mutate(data, most_bytes))
            if len(changed) <= most_bytes:
                return changed
        return bytes(atheris.Mutate(data, most_bytes))

    options = {
        "max_total_time": seconds,
        "artifact_prefix": f"{corpus}/",
        "timeout": LONGEST_S,
        "rss_limit_mb": MOST_MEMORY_BYTES >> 20,
        "max_len": LONGEST_INPUT_BYTES,
        "len_control": 0,
        "print_final_stats": 1,
    }
    words = [f"-{option}={value}" for option, value in options.items()]
    atheris.Setup(
        [name, *words, str(kept), str(corpus)],
        lambda data: read(name, data),
        custom_mutator=mutate,
    )
    atheris.Fuzz()


def run(name: str, seconds: int) -> bool:
    """Fuzz one reader in a process of its own; whether all was answered cleanly."""
    began = time.monotonic()
    ended = subprocess.run(
        [sys.executable, __file__, "--seconds", str(seconds), "--here", name],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        check=False,
        # The order of a set must not tell whether an input fails.
        env={**os.environ, "PYTHONHASHSEED": "0"},
    )
    said = ended.stderr.decode(errors="replace")
    number = re.search(r"number_of_executed_units: (\d+)", said)
    count = number[1] if number else "?"
    failed = f"FAILED\n{ended.stdout.decode(errors='replace')[-4000:]}{said[-500:]}"
    result = "clean" if ended.returncode == 0 else failed
    line = f"{name:<12} {count:>9} inputs {time.monotonic() - began:>6.0f} s  {result}"
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()
    return ended.returncode == 0


def main() -> int:
    """Fuzz readers for some time each; the exit status says whether all answers were clean."""
    parser = argparse.ArgumentParser(description="Fuzz every reader.")
    parser.add_argument("--seconds", type=int, default=60, help="for each reader")
    parser.add_argument("--here", help=argparse.SUPPRESS)
    parser.add_argument("readers", nargs="*")
    options = parser.parse_args()
    if options.here:
        fuzz(options.here, options.seconds)
    from readers import READERS

    with ThreadPoolExecutor(AT_A_TIME) as pool:
        names = options.readers or READERS
        clean = [*pool.map(lambda name: run(name, options.seconds), names)]
    sys.stdout.write(f"{sum(clean)} passed, {len(clean) - sum(clean)} failed\n")
    return 0 if all(clean) else 1


if __name__ == "__main__":
    sys.exit(main())
