"""Files in the format of programs and libraries."""

from __future__ import annotations

import struct

AMD64 = 62


def elf_file(*segments: tuple[int, bytes], machine: int = AMD64, content: bytes = b"") -> bytes:
    """A file of 64 bits with segments, each a type and its content, and further content."""
    header = b"\x7fELF\x02\x01\x01" + bytes(9)
    header += struct.pack(
        "<HHIQQQIHHHHHH", 2, machine, 1, 0, 64, 0, 0, 64, 56, len(segments), 0, 0, 0
    )
    table, contents = b"", b""
    for kind, data in segments:
        offset = 64 + 56 * len(segments) + len(contents)
        table += struct.pack("<IIQQQQQQ", kind, 4, offset, 0, 0, len(data), len(data), 4)
        contents += data
    return header + table + contents + content
