"""A coverage-guided fuzzer of `r2bspec validate`, run by hand.

::

    pip install atheris
    python tests/fuzz/fuzz_validate.py tests/fuzz/corpus -max_total_time=300

Whatever the bytes, validate must end with a spec or with a reason, render it in every form, and
repair without making it worse. A file that breaks this is written to the current folder; once it
is understood, its smallest form goes into ``corpus/``, which a test replays.
"""

from __future__ import annotations

import sys
from importlib import import_module

from fuzz_target import check_bytes


def main() -> None:
    """Fuzz until told to stop; arguments are those of libFuzzer."""
    atheris = import_module("atheris")  # only where it is installed, and without types
    atheris.instrument_all()
    atheris.Setup(sys.argv, check_bytes)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
