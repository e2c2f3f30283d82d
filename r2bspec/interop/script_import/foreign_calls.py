"""What well-known functions outside of a script return, without calling them.

Paths that depend on the machine are texts with a reference: ``$(share PACKAGE)``, ``$(assets)``,
``$(script)`` and ``$(env NAME)``. The writer of the spec turns them into variables.
"""

from __future__ import annotations

import posixpath
from collections.abc import Callable
from typing import Any

from r2bspec.interop.script_import.script_values import (
    Construct,
    ImageSize,
    Place,
    Unknown,
    unknown_in,
)

NOT_KNOWN = object()
"""Returned for a function that is not in the table."""

_SIZES = {
    "QUARTER_HD": (960, 540, "Quarter HD"),
    "VGA": (640, 480, "VGA"),
    "WVGA": (720, 480, "WVGA"),
    "HD": (1280, 720, "HD"),
    "FULL_HD": (1920, 1080, "Full HD"),
    "WUXGA": (1920, 1200, "WUXGA"),
    "FOUR_K": (3840, 2160, "4K"),
}
"""``ros2_benchmark.ImageResolution``."""


def foreign_value(name: str) -> Any:
    """The value of an imported constant, or `NOT_KNOWN`."""
    above, _, last = name.rpartition(".")
    if above.endswith("ImageResolution") and last in _SIZES:
        width, height, label = _SIZES[last]
        return ImageSize(width, height, label)
    return NOT_KNOWN


def foreign_call(name: str, arguments: list[Any], keywords: dict[str, Any], place: Place) -> Any:
    """The result of a call, or `NOT_KNOWN`."""
    known = _CALLS.get(name) or _CALLS_BY_LAST.get(name.rpartition(".")[2])
    if known is None:
        return NOT_KNOWN
    missing = unknown_in([arguments, keywords])
    if missing is not None:
        return missing
    try:
        return known(arguments, keywords, place)
    except (TypeError, ValueError, IndexError, KeyError, AttributeError, ArithmeticError):
        return Unknown(f"the arguments of {name.rpartition('.')[2]} are not understood", place)


def join_path(parts: list[Any], place: Place) -> Any:
    """``os.path.join`` of texts."""
    if not parts or not all(isinstance(each, str) for each in parts):
        return Unknown("a part of the path is not a text", place)
    return posixpath.join(*parts)


def _flattened(arguments: list[Any]) -> list[Any]:
    return [
        one for each in arguments for one in (each if isinstance(each, list | tuple) else [each])
    ]


def _first_text(call: Callable[[str], str]) -> Callable[..., Any]:
    def result(arguments: list[Any], _keywords: dict[str, Any], place: Place) -> Any:
        if not isinstance(arguments[0], str):
            return Unknown("the argument is not a text", place)
        return call(arguments[0])

    return result


def _folder(path: str) -> str:
    return "$(script)" if path == "$(script)" else posixpath.dirname(path)


def _environment(arguments: list[Any], keywords: dict[str, Any], place: Place) -> Any:
    name = arguments[0] if arguments else keywords["name"]
    return f"$(env {name})" if isinstance(name, str) else Unknown("no name", place)


def _size(arguments: list[Any], keywords: dict[str, Any], _place: Place) -> Any:
    given = dict(zip(("width", "height", "name"), arguments, strict=False)) | keywords
    return ImageSize(int(given["width"]), int(given["height"]), str(given.get("name", "")))


def _share(arguments: list[Any], keywords: dict[str, Any], place: Place) -> Any:
    name = "".join(_flattened(arguments[:1])) or keywords.get("package_name", keywords["package"])
    return f"$(share {name})" if name else Unknown("no package", place)


def _text(arguments: list[Any], keywords: dict[str, Any], _place: Place) -> Any:
    return str(arguments[0] if arguments else keywords["text"])


_CALLS: dict[str, Callable[..., Any]] = {
    "os.path.join": lambda arguments, _keywords, place: join_path(arguments, place),
    "os.path.dirname": _first_text(_folder),
    "os.path.basename": _first_text(posixpath.basename),
    "os.path.abspath": _first_text(str),
    "os.path.realpath": _first_text(str),
    "os.path.normpath": _first_text(posixpath.normpath),
    "os.path.splitext": _first_text(posixpath.splitext),  # type: ignore[arg-type]
    "os.path.expandvars": _first_text(str),
    "os.getenv": _environment,
    "os.environ.get": _environment,
    "pathlib.Path": lambda arguments, _keywords, place: join_path(arguments, place),
    "copy.deepcopy": lambda arguments, _keywords, _place: arguments[0],
    "copy.copy": lambda arguments, _keywords, _place: arguments[0],
    "ros2_benchmark.ROS2BenchmarkTest.get_assets_root_path": lambda *_: "$(assets)",
}

_CALLS_BY_LAST: dict[str, Callable[..., Any]] = {
    "get_package_share_directory": _share,
    "get_package_share_path": _share,
    "FindPackageShare": _share,
    "PathJoinSubstitution": lambda arguments, _keywords, place: join_path(
        _flattened(arguments), place
    ),
    "TextSubstitution": _text,
    "EnvironmentVariable": _environment,
    "Resolution": _size,
}


def is_file_test(value: Any) -> bool:
    """Whether a value is the result of ``os.path.isfile`` or a similar test."""
    return isinstance(value, Construct) and value.name in {
        "os.path.isfile",
        "os.path.exists",
        "os.path.isdir",
    }
