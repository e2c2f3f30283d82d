"""Coverage-guided fuzzing of every reader: ``make fuzz``.

::

    python tests/fuzz/fuzz.py --seconds 60 [READER...]

Inputs that reach new code are kept in ``.fuzz``, where the next call begins with them. One that is
not answered cleanly (`readers`) is written to ``tests/fuzz/corpus``, which the unit tests play:
commit it with the repair. Each target is a process of its own, two at a time.

Pipelines try the inputs of one seed (``--seed``), nightly runs others. What the player in C reads
of a file is guided by its own code where there is a clang.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests/support"), str(ROOT / "tests/fuzz")]
sys.dont_write_bytecode = True

AT_A_TIME = 2
LONGEST_S = 60
"""After which an input is taken for one that never ends."""

MOST_MEMORY_BYTES = 4 << 30
LONGEST_INPUT_BYTES = 1 << 16
PLAYER = "playback"
PLAYER_BY_CLANG = "playback-clang"
_OF_BYTES = 0.25
"""The share of changes that know nothing of the structure."""


def fuzz(name: str, seconds: int, seed: int) -> None:
    """Fuzz one reader in this process, which ends here."""
    import atheris

    # Also of what the readers import later: it never ends.
    atheris.instrument_imports(
        include=["r2bspec", "rosbags"], enable_loader_override=False
    ).__enter__()
    from readers import READERS, read

    reader = READERS[name]
    reader.prepare()
    # Not before: a program with the address sanitizer reserves more.
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY_BYTES, MOST_MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    words = libfuzzer_words(name, seconds, seed)
    for first in reader.seeds():
        (ROOT / ".fuzz" / name / hashlib.sha256(first).hexdigest()).write_bytes(first)

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

    atheris.Setup([name, *words], lambda data: read(name, data), custom_mutator=mutate)
    atheris.Fuzz()


def libfuzzer_words(name: str, seconds: int, seed: int) -> list[str]:
    """The arguments of libFuzzer for one reader, whose folders are made."""
    kept, corpus = ROOT / ".fuzz" / name, ROOT / "tests/fuzz/corpus" / name
    for folder in (kept, corpus):
        folder.mkdir(parents=True, exist_ok=True)
    options = {
        "seed": seed,
        "max_total_time": seconds,
        "artifact_prefix": f"{corpus}/",
        "timeout": LONGEST_S,
        "rss_limit_mb": MOST_MEMORY_BYTES >> 20,
        "max_len": LONGEST_INPUT_BYTES,
        "len_control": 0,
        "report_slow_units": LONGEST_S,
        "print_final_stats": 1,
    }
    return [*(f"-{option}={value}" for option, value in options.items()), str(kept), str(corpus)]


def player_by_clang(seconds: int, seed: int) -> list[str]:
    """The command that fuzzes the player in C with the libFuzzer of clang."""
    from native_playlists import player_without_ros

    clang = shutil.which("clang") or ""
    flags = ("-fsanitize=fuzzer,address,undefined", "-fno-sanitize-recover=all", "-DLIBFUZZER")
    program = str(player_without_ros(flags, [clang]))
    return [program, "-close_fd_mask=1", *libfuzzer_words(PLAYER, seconds, seed)]


def run(name: str, seconds: int, seed: int) -> bool:
    """Fuzz one reader in a process of its own; whether all was answered cleanly."""
    began = time.monotonic()
    numbers = ["--seconds", str(seconds), "--seed", str(seed)]
    command = [sys.executable, __file__, *numbers, "--here", name]
    ended = subprocess.run(
        player_by_clang(seconds, seed) if name == PLAYER_BY_CLANG else command,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        check=False,
        # The order of a set must not tell whether an input fails.
        env={**os.environ, "PYTHONHASHSEED": "0"},
    )
    said = ended.stderr.decode(errors="replace")
    number = re.search(r"number_of_executed_units: (\d+)", said)
    count = number[1] if number else "?"
    failed = f"FAILED\n{ended.stdout.decode(errors='replace')[-4000:]}{said[-2000:]}"
    result = "clean" if ended.returncode == 0 else failed
    _say(f"{name:<14} {count:>9} inputs {time.monotonic() - began:>6.0f} s  {result}")
    return ended.returncode == 0


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def main() -> int:
    """Fuzz readers for some time each; the exit status says whether all answers were clean."""
    parser = argparse.ArgumentParser(description="Fuzz every reader.")
    parser.add_argument("--seconds", type=int, default=60, help="for each reader")
    parser.add_argument("--seed", type=int, default=0, help="the same inputs again; 0 for others")
    parser.add_argument("--here", help=argparse.SUPPRESS)
    parser.add_argument("readers", nargs="*")
    options = parser.parse_args()
    if importlib.util.find_spec("atheris") is None:
        _say("fuzz: skipped, because atheris has no wheel for this machine")
        return 0
    if options.here:
        fuzz(options.here, options.seconds, options.seed)
    from readers import READERS

    names = options.readers or [*READERS, PLAYER_BY_CLANG]
    if PLAYER_BY_CLANG in names and shutil.which("clang") is None:
        names.remove(PLAYER_BY_CLANG)
        _say(f"{PLAYER_BY_CLANG}: skipped, because there is no clang")
    with ThreadPoolExecutor(AT_A_TIME) as pool:
        clean = [*pool.map(lambda name: run(name, options.seconds, options.seed), names)]
    _say(f"{sum(clean)} passed, {len(clean) - sum(clean)} failed")
    return 0 if all(clean) else 1


if __name__ == "__main__":
    sys.exit(main())
