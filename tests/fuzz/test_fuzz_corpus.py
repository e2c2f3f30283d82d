"""Inputs that a fuzzer found interesting, or that once broke something: all are answered."""

from __future__ import annotations

import contextlib
import random
import runpy
import subprocess
from pathlib import Path

import pytest
from hostile_inputs import damaged
from readers import CORPUS, READERS, Reader, read

from nightly import size

FILES = [(name, file) for name in READERS for file in sorted((CORPUS / name).glob("*"))]


@pytest.mark.timeout(60)
@pytest.mark.parametrize(("name", "file"), FILES, ids=[f"{n} {f.name}" for n, f in FILES])
def test_replay(name: str, file: Path) -> None:
    read(name, file.read_bytes())


@pytest.mark.parametrize("name", READERS)
def test_seeds(name: str) -> None:
    """What targets begin with is of use."""
    for seed in READERS[name].seeds():
        read(name, seed)


@pytest.mark.parametrize("name", READERS)
def test_damaged_seeds(name: str) -> None:
    """Each has a few changes that keep to the structure of such an input."""
    rng = random.Random(name)  # noqa: S311 - repeatable damage
    seeds = [*READERS[name].seeds()]
    for _ in range(size(5, 300)):
        seed = rng.choice(seeds)
        try:
            changed = READERS[name].mutate(seed, rng)
        except Exception:  # of the parser of what is changed
            changed = damaged(rng, seed)
        read(name, changed)


@pytest.mark.parametrize(
    ("code", "says"),
    [
        ("Path('/tmp/r2bspec-fuzz-x').write_text('')", "forbidden: .*open"),
        ("Path('../x').write_text('')", "a file is left"),
        ("Path('x').symlink_to('/')", ""),
        ("Path('x').rename('/x')", "forbidden: .*os.rename"),
        ("subprocess.run(['true'])", "forbidden: .*subprocess.Popen"),
        ("Path('x.py').write_text('1'); runpy.run_path('x.py')", "forbidden: .*exec"),
        ("sum(range(10**7)) * 10**9", "too much time"),
        ("len(bytearray(b'x') * 500_000_000)", "too much memory"),
    ],
)
def test_what_is_not_clean_is_noticed(
    code: str, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(data: bytes, folder: Path) -> None:
        with contextlib.suppress(OSError):
            exec(data, {"Path": Path, "subprocess": subprocess, "runpy": runpy})  # noqa: S102

    if says == "too much time":
        monkeypatch.setattr("readers.MOST_CPU_S", 0.05)
    monkeypatch.setitem(READERS, "x", Reader(run, lambda data, _: data))
    with pytest.raises(AssertionError, match=says) if says else contextlib.nullcontext():
        read("x", code.encode())
