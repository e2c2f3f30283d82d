"""Changes that get behind the first check of a reader: they keep to the structure of its input.

A mutation takes an input and a source of chance, and makes another input. It may raise whatever the
parser of a damaged input raises; such an input is then changed byte by byte.
"""

from __future__ import annotations

import ast
import copy
import gzip
import io
import json
import random
import re
import sqlite3
import struct
import tarfile
import zlib
from collections.abc import Callable, Sequence
from typing import Any
from xml.etree import ElementTree as ET

import yaml
from hostile_inputs import REPLACEMENTS, STATEMENTS, damaged, paths

Mutation = Callable[[bytes, random.Random], bytes]

NUMBERS = (0, 1, -1, 2, 255, 1 << 15, (1 << 31) - 1, -(1 << 31), 1 << 32, 1 << 62, (1 << 63) - 1)
NUMBERS_OF_BYTES = (4, 8)
_MOST_ALIASES = 4
"""A document of a few lines can be a bomb with more, which a mutation would unfold."""


def document(
    words: Sequence[Any] = (),
    load: Callable[[bytes], Any] = json.loads,
    dump: Callable[[Any], bytes] = lambda value: json.dumps(value).encode(),
) -> Mutation:
    """Changes of the values and keys of a document; `words` are keys and values that mean much."""

    def mutate(data: bytes, rng: random.Random) -> bytes:
        root = [load(data)]
        for _ in range(rng.randint(1, 3)):
            *above, key = rng.choice([*paths(root)][1:])
            parent = _at(root, above)
            other = copy.deepcopy(_at(root, rng.choice([*paths(root)][1:])))
            value = rng.choice((other, rng.choice([*REPLACEMENTS, *words]), *_near(parent[key])))
            match rng.randrange(5):
                case 0 if above:
                    del parent[key]
                case 1 if isinstance(parent, dict):
                    parent[str(rng.choice([*words, key]))] = parent.pop(key)
                case 2 if isinstance(parent, dict):
                    parent[str(rng.choice([*words, key]))] = value
                case 2 if above:
                    parent.insert(key, value)
                case _:
                    parent[key] = value
        return dump(root[0])

    return mutate


def _at(value: Any, path: Sequence[Any]) -> Any:
    for key in path:
        value = value[key]
    return value


def _near(value: Any) -> tuple[Any, ...]:
    """Values that are like this one."""
    match value:
        case bool():
            return (not value,)
        case int() | float():
            return value + 1, -value, value * 1000
        case str():
            return value + value, value[1:], value.upper()
    return ()


def yaml_document(words: Sequence[Any] = ()) -> Mutation:
    """As `document`, of YAML."""

    def load(data: bytes) -> Any:
        if data.count(b"*") > _MOST_ALIASES:
            raise ValueError("many aliases")
        return yaml.load(data, Loader=yaml.CSafeLoader)

    def dump(value: Any) -> bytes:
        text: str = yaml.dump(value, Dumper=yaml.CSafeDumper, sort_keys=False, allow_unicode=True)
        return text.encode("utf-8", "surrogatepass")

    return document(words, load, dump)


def text(words: Sequence[str]) -> Mutation:
    """Words and lines of a text in other places, and words of a language."""

    def mutate(data: bytes, rng: random.Random) -> bytes:
        parts = re.findall(rb"\w+|\s+|.", data, re.DOTALL)
        for _ in range(rng.randint(1, 4)):
            at, length = rng.randrange(len(parts)), rng.randint(0, 3)
            taken = rng.randrange(len(parts))
            parts[at : at + length] = rng.choice(
                [parts[taken : taken + rng.randint(0, 8)], [rng.choice(words).encode()]]
            )
        return b"".join(parts)

    return mutate


def python(data: bytes, rng: random.Random) -> bytes:
    """Expressions and statements of a script in the places of others."""
    tree = ast.parse(data)
    nodes = [*ast.walk(tree)]
    places: list[tuple[ast.AST, str, Any]] = [
        (node, name, value)
        for node in nodes
        for name, value in ast.iter_fields(node)
        if isinstance(value, ast.expr | list | str) and value
    ]
    for _ in range(rng.randint(1, 3)):
        node, name, value = rng.choice(places)
        others = [other for _, _, other in places if type(other) is type(value)]
        if isinstance(value, ast.expr):
            others = [expression for expression in nodes if isinstance(expression, ast.expr)]
        other = copy.deepcopy(rng.choice(others))
        if isinstance(value, list) and rng.random() < 0.5:
            value.insert(rng.randint(0, len(value)), copy.deepcopy(rng.choice(value)))
        elif not isinstance(value, list) or type(other[0]) is type(value[0]):
            setattr(node, name, other)
    return ast.unparse(ast.fix_missing_locations(tree)).encode()


def xml(words: Sequence[str]) -> Mutation:
    """Elements inside of others, and attributes with other names and values."""

    def mutate(data: bytes, rng: random.Random) -> bytes:
        root = ET.fromstring(data)  # noqa: S314 - of this fuzzer
        elements = [*root.iter()]
        names = [*words, *(name for element in elements for name in (element.tag, *element.attrib))]
        values = [*words, *(value for element in elements for value in element.attrib.values())]
        for _ in range(rng.randint(1, 3)):
            element, other = rng.choice(elements), rng.choice(elements)
            match rng.randrange(4):
                case 0:
                    element.append(copy.deepcopy(other))
                case 1 if len(element):
                    element.remove(rng.choice([*element]))
                case 2:
                    element.tag = rng.choice(names)
                case _:
                    value = f"{rng.choice(values)}{rng.choice(['', rng.choice(values)])}"
                    element.set(rng.choice(names), value)
        return ET.tostring(root)

    return mutate


def numbers(data: bytes, rng: random.Random) -> bytes:
    """Numbers and bits that are others; mostly of the same length, so that offsets stay true."""
    if not data or rng.random() < 0.2:
        return damaged(rng, data)
    changed = bytearray(data)
    width = rng.choice(NUMBERS_OF_BYTES)
    if len(changed) < width or rng.random() < 0.3:
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    else:
        at = rng.randrange(len(changed) - width + 1)
        number = rng.choice([*NUMBERS, len(data), rng.randrange(len(data))])
        changed[at : at + width] = (number % (1 << 8 * width)).to_bytes(width, "little")
    return bytes(changed)


def sqlite(data: bytes, rng: random.Random) -> bytes:
    """Other values in a database, or other tables."""
    if rng.random() < 0.2:
        return numbers(data, rng)
    with sqlite3.connect(":memory:") as database:
        database.deserialize(data)
        if rng.random() < 0.2:
            database.executescript(rng.choice(STATEMENTS))
        else:
            tables = database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
            table = rng.choice(tables.fetchall())[0]
            column = rng.choice(database.execute(f'PRAGMA table_info("{table}")').fetchall())[1]
            place = f'FROM "{table}" ORDER BY random() LIMIT 1'
            old = database.execute(f'SELECT "{column}" {place}').fetchone()[0]
            if isinstance(old, bytes):
                new: Any = numbers(old, rng)
            else:
                new = rng.choice([*NUMBERS, *map(str, REPLACEMENTS[:13]), b"\0", *_near(old)])
            where = f"WHERE rowid IN (SELECT rowid {place})"
            database.execute(f'UPDATE "{table}" SET "{column}" = ? {where}', (new,))  # noqa: S608
        database.commit()
        return database.serialize()


_MAGIC = b"\x89MCAP0\r\n"
_DATA_END, _FOOTER, _CHUNK = 0x0F, 0x02, 0x06


def mcap(data: bytes, rng: random.Random) -> bytes:
    """Fields of a record, also in an uncompressed chunk, with true lengths and check sums."""
    if not data.startswith(_MAGIC):
        raise ValueError("no MCAP")
    return _MAGIC + _mcap_records(data[len(_MAGIC) : -len(_MAGIC)], rng) + _MAGIC


def _mcap_records(data: bytes, rng: random.Random) -> bytes:
    records: list[tuple[int, bytes]] = []
    at = 0
    while at < len(data):
        kind, length = struct.unpack_from("<BQ", data, at)
        records.append((kind, data[at + 9 : at + 9 + length]))
        at += 9 + length
    number = rng.randrange(len(records))
    kind, content = records[number]
    match rng.randrange(6):
        case 0:
            records.insert(rng.randint(0, len(records)), (kind, content))
        case 1:
            del records[number]
        case _ if kind == _CHUNK and content[28:32] == bytes(4):
            # Times, size, check sum, no name of a compression, length.
            inner = _mcap_records(content[40:], rng)
            head = content[:16] + struct.pack("<QIIQ", len(inner), zlib.crc32(inner), 0, len(inner))
            records[number] = kind, head + inner
        case _:
            records[number] = kind, numbers(content, rng)
    # A check sum of zero is none.
    sums = {_DATA_END: -4, _FOOTER: -4}
    return b"".join(
        struct.pack("<BQ", kind, len(content))
        + (content[: sums[kind]] + bytes(4) if kind in sums else content)
        for kind, content in records
    )


def ros1(data: bytes, rng: random.Random) -> bytes:
    """Fields of the header of a record, or its data, with true lengths."""
    magic, rest = data[:13], data[13:]
    records: list[list[bytes]] = []
    while rest:
        halves = []
        for _ in range(2):
            (length,) = struct.unpack_from("<I", rest)
            halves.append(rest[4 : 4 + length])
            rest = rest[4 + length :]
        records.append(halves)
    record = rng.choice(records)
    half = rng.randrange(2)
    record[half] = numbers(record[half], rng)
    parts = (part for record in records for part in record)
    return magic + b"".join(struct.pack("<I", len(part)) + part for part in parts)


def archive(data: bytes, rng: random.Random) -> bytes:
    """Entries of a compressed archive with other names, kinds, sizes and links."""
    if rng.random() < 0.2:
        return gzip.compress(numbers(gzip.decompress(data), rng))
    with tarfile.open(fileobj=io.BytesIO(data)) as tar:
        entries = [(entry, tar.extractfile(entry)) for entry in tar]
        contents = [(entry, file.read() if file else b"") for entry, file in entries]
    names = ["..", "/x", "a/../../x", "x" * 300, "a\0b", "", ".", "\udcff", *tar.getnames()]
    entry, _ = rng.choice(contents)
    match rng.randrange(5):
        case 0:
            entry.name = rng.choice(names)
        case 1:
            entry.type = rng.choice([*b"0123456789gxLKS"]).to_bytes(1, "big")
            entry.linkname = rng.choice(names)
        case 2:
            entry.mode = rng.choice(NUMBERS) % (1 << 20)
        case 3:
            entry.pax_headers = {rng.choice(["path", "size", "mtime", "linkpath"]): "9" * 20}
        case _:
            contents.append(rng.choice(contents))
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w:gz", compresslevel=1) as tar:
        for entry, content in contents:
            tar.addfile(entry, io.BytesIO(content))
    return packed.getvalue()


def by_start(starts: dict[bytes, Mutation], otherwise: Mutation) -> Mutation:
    """The mutation of the kind of file that the first bytes tell."""

    def mutate(data: bytes, rng: random.Random) -> bytes:
        fitting = (starts[start] for start in starts if data.lstrip().startswith(start))
        return next(fitting, otherwise)(data, rng)

    return mutate
