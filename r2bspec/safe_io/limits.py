"""Every limit on what is read, in one place: what, how much, and why no more.

A limit keeps a hostile or damaged file from taking the memory or the time of the machine; real
files stay far below. A file that exceeds a limit is refused with an error that names it. Bytes,
unless the name says otherwise. Limits on what is written, shown or waited for are where that is
done.
"""

from __future__ import annotations

from typing import Final

# Documents: specs, parameters, interfaces

MAX_DOCUMENT_BYTES: Final = 10_000_000
"""A spec has a few thousand."""
MAX_YAML_DEPTH: Final = 100
"""Of lists and maps inside each other."""
MAX_YAML_VALUES: Final = 400_000
"""Written in one document."""
MAX_YAML_EXPANDED_VALUES: Final = 200_000
"""Inserted by aliases and merge keys."""
MAX_INTEGER_CHARACTERS: Final = 25
"""Of any integer within 64 bits, with prefix and sign."""
MAX_QUANTITY_CHARACTERS: Final = 40
"""Such as '29.97 Hz'."""
MAX_REQUIREMENT_CHARACTERS: Final = 300
"""Such as 'latency.p99 < 50 ms'."""
MAX_EXTENDS_DEPTH: Final = 20
"""Files, each of which extends the next."""
MAX_SPEC_ENTRIES: Final = 5_000
"""Nodes, inputs, monitors or topics: far above every real spec."""
MAX_RANGE_RATES: Final = 1_000
"""Of a range of rates."""
MAX_CASES: Final = 1_000
"""Of the matrix of a document."""
MAX_CASE_NAME_CHARACTERS: Final = 200
"""A part of the names of files."""
MAX_PARAMETER_SOURCES: Final = 100
"""Parameter files and maps that one node lists."""
MAX_COMPANION_BYTES: Final = 1_000_000
"""One parameter file or interface."""
MAX_COMPANION_DEPTH: Final = 50
"""Of lists and maps inside each other."""
MAX_COMPANION_VALUES: Final = 50_000
"""Of one of them."""
MAX_PARAMETERS: Final = 10_000
"""Of one file, after aliases."""
MAX_KNOWN_INTERFACES_BYTES: Final = 64_000_000
"""Interfaces of all packages that were introspected."""

# Python and launch files

MAX_PYTHON_BYTES: Final = 300_000
"""The parser needs up to 700 bytes of memory for each."""
MAX_BASE_CLASSES: Final = 100
"""Classes may name each other as their bases."""

# Recordings, of any size

MAX_METADATA_BYTES: Final = 16_000_000
"""Metadata.yaml, and what a dataset says of itself."""
MAX_NAME_CHARACTERS: Final = 1_000
"""Of a topic, a type, a monitor: ROS has 255."""
MAX_STAMPS_BYTES: Final = 64 << 20
"""Of larger bags only the first stamps are read; their counts are compared."""
MAX_RECORDED_TIMES: Final = 1_000_000
"""Times of recording that are looked at for gaps in a bag of any size."""

# Runs, results and reports

MAX_JSON_BYTES: Final = 256_000_000
"""The record of a day of segments has a tenth."""
MAX_SEGMENTS: Final = 3_000
"""Of one run, and pairs of a comparison: eight hours at ten seconds each. A thousand take a second
to judge, and as long again for a page."""
MAX_PLANNED_ITERATIONS: Final = 2_000
"""At all rates together: confirmed, and played again, they stay below `MAX_SEGMENTS`."""
MAX_PROCESSES: Final = 10_000
"""Of one run, in all of its starts."""
MAX_INTEGER: Final = 2**63 - 1
"""Times are ns in 64 bits with a sign, in every file and array."""
MAX_NUMBER: Final = 1e30
"""Beyond every rate, time and size, far from the limits of a float."""
MAX_SAMPLES_BYTES: Final = 512 << 20
"""One array of samples."""
MAX_ANATOMY_EVENTS: Final = 4_000_000
"""Of all processes of a start together: 20,000 a second for three minutes."""
MAX_ANATOMY_FILES: Final = 1_000
"""Processes of one start whose events are recorded: a large graph has some dozens."""
MAX_DIGEST_BYTES: Final = 512_000_000
"""A program whose content is compared."""
MAX_LOADED_NAMES_BYTES: Final = 16 << 20
"""Names of files that a process has loaded."""
MAX_MANIFEST_BYTES: Final = 1_000_000
"""A package.xml."""
MAX_COMMAND_OUTPUT_BYTES: Final = 64 << 20
"""What a build of a base, or a setup file, prints: far more than either needs."""
MAX_PATH_FILE_BYTES: Final = 1 << 20
"""A .pth file of an environment."""
MAX_GIT_REFS: Final = 1_000
"""That are named by what git prints."""
# Fleets

MAX_FLEET_ARCHIVE_BYTES: Final = 2 << 30
"""Unpacked: of the files of a spec, or of a run folder. It travels as one message."""
MAX_FLEET_ARCHIVE_FILES: Final = 20_000
"""A folder that a command names may be a whole workspace."""
