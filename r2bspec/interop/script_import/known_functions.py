"""What functions, methods and operators outside of a script return for values that are known.

There are two kinds. Python's own are called, if they are in the tables here: those without an
effect on anything but their object, with results within the limits; the caller limits what is put
in. Well-known
functions of packages are not called: their results are written down here. Paths that depend on the
machine are texts with a reference, ``$(share PACKAGE)``, ``$(assets)``, ``$(script)`` and
``$(env NAME)``, which the writer of the spec turns into variables.

Whatever is not in the tables, or fails, has no known value.
"""

from __future__ import annotations

import ast
import operator
import posixpath
import re
from collections.abc import Callable, Mapping
from typing import Any, Final

from r2bspec.diagnostics import Span
from r2bspec.interop.script_import.values import (
    Construct,
    CopiedEnvironment,
    ImageSize,
    LaunchText,
    NotKnownError,
    ScriptLimitError,
    require_known,
)
from r2bspec.safe_io.limits import MAX_SCRIPT_BITS, MAX_SCRIPT_ITEMS, MAX_SCRIPT_TEXT

ASSETS: Final = "$(assets)"

_FUNCTIONS: Final[dict[str, Callable[..., Any]]] = {
    "str": lambda value="": _as_text(value),
    "reversed": lambda value: list(reversed(value)),
    "zip": lambda *values: list(zip(*values, strict=False)),
    "enumerate": lambda values, start=0: list(enumerate(values, start)),
    "range": lambda *ends: _range(*ends),
    **{
        function.__name__: function
        for function in (
            *(bool, int, float, abs, round, min, max, sum),
            *(list, tuple, dict, len, sorted, repr),
        )
    },
}
_METHODS: Final[dict[type, str]] = {
    str: "lower upper title capitalize strip lstrip rstrip split rsplit splitlines partition "
    "rpartition join replace startswith endswith removeprefix removesuffix format zfill",
    list: "append extend insert copy index count pop remove reverse",
    dict: "items keys values get update copy setdefault pop",
    tuple: "index count",
}
"""Methods without effects on anything but the object itself."""
_IDENTITY_METHODS: Final = frozenset({"perform", "evaluate", "as_posix"})
"""Of a launch substitution whose value is known, or of a path."""

_BINARY: Final[dict[type, Callable[[Any, Any], Any]]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.BitOr: operator.or_,
}
_COMPARISONS: Final[dict[type, Callable[[Any, Any], bool]]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: lambda left, right: left in right,
    ast.NotIn: lambda left, right: left not in right,
    ast.Is: operator.is_,
    ast.IsNot: operator.is_not,
}
_LAUNCH_VALUES: Final = frozenset(
    {"LaunchConfiguration", "LaunchConfigurationEquals", "LaunchConfigurationNotEquals"}
)
_DECIDED_BY_MACHINE: Final = "$(env "
_ENVIRONMENT: Final = {"ROS_DISTRO": "jazzy", "ROS_VERSION": "2"}
"""What the ROS that runs a benchmark sets itself."""
_LARGE_WIDTH: Final = re.compile(r"[0-9]{4,}")
"""A field of a format that would be padded to thousands of characters."""

_SIZES: Final = {
    "QUARTER_HD": ImageSize(960, 540, "Quarter HD"),
    "VGA": ImageSize(640, 480, "VGA"),
    "WVGA": ImageSize(720, 480, "WVGA"),
    "HD": ImageSize(1280, 720, "HD"),
    "FULL_HD": ImageSize(1920, 1080, "Full HD"),
    "WUXGA": ImageSize(1920, 1200, "WUXGA"),
    "FOUR_K": ImageSize(3840, 2160, "4K"),
}
"""``ros2_benchmark.ImageResolution``."""


def has_function(name: str) -> bool:
    """Whether a name is one of Python's own functions that are known here."""
    return name in _FUNCTIONS


def has_method(owner: Any, name: str) -> bool:
    """Whether a method of a value is known here."""
    return name in _IDENTITY_METHODS or any(
        isinstance(owner, kind) and name in names.split() for kind, names in _METHODS.items()
    )


def call_function(name: str, arguments: list[Any], keywords: dict[str, Any]) -> Any:
    """The result of one of Python's own functions.

    Raises:
        NotKnownError: it is not one of those, or raises.
    """
    what = "the content of a file" if name == "open" else f"the result of {name}()"
    function = _FUNCTIONS.get(name)
    if function is None:
        raise NotKnownError(f"{what} is not known")
    return _result(lambda: function(*arguments, **keywords), what)


def call_method(owner: Any, name: str, arguments: list[Any], keywords: dict[str, Any]) -> Any:
    """The result of a method of a text, list, tuple or map.

    Raises:
        NotKnownError: it raises, or would make a text too long.
    """
    if name in _IDENTITY_METHODS:
        return str(owner) if isinstance(owner, str) else owner
    what = f"the result of {name}()"
    if name in {"format", "zfill"} and _LARGE_WIDTH.search(f"{owner} {arguments}"):
        raise NotKnownError(f"{what} is not known")
    result = _result(lambda: getattr(owner, name)(*arguments, **keywords), what)
    return list(result) if name in {"items", "keys", "values"} else result


def binary(kind: type, left: Any, right: Any) -> Any:
    """The result of a binary operator.

    Raises:
        NotKnownError: it is not in the table, or raises.
    """
    what = "the operands"
    if kind is ast.Div and isinstance(left, str) and isinstance(right, str):
        return posixpath.join(left, right)
    if kind is ast.Mult and any(isinstance(side, str | list | tuple) for side in (left, right)):
        _check_repetition(left, right)
    if kind not in _BINARY or (
        kind is ast.Mod and isinstance(left, str) and _LARGE_WIDTH.search(left)
    ):
        raise NotKnownError(f"{what} are not known")
    return _result(lambda: _BINARY[kind](left, right), what, "are")


def compare(kind: type, left: Any, right: Any) -> bool:
    """The result of a comparison; errors as for `binary`."""
    if any(isinstance(side, str) and _DECIDED_BY_MACHINE in side for side in (left, right)):
        raise NotKnownError("what is compared depends on an environment variable")
    return bool(_result(lambda: _COMPARISONS[kind](left, right), "what is compared"))


def formatted(value: Any, width: Any) -> str:
    """A value inside of an f-string.

    Raises:
        NotKnownError: its text or the format is not known.
    """
    what = "a part of the text"
    if isinstance(width, str) and len(width) <= 6 and isinstance(value, int | float | str):
        return str(_result(lambda: format(value, width), what))
    if width:
        raise NotKnownError(f"{what} is not known")
    return str(_result(lambda: _as_text(value), what))


def _result(call: Callable[[], Any], what: str, verb: str = "is") -> Any:
    try:
        result = call()
    except (TypeError, ValueError, KeyError, IndexError, ArithmeticError, AttributeError) as error:
        raise NotKnownError(f"{what} {verb} not known") from error
    if isinstance(result, str) and len(result) > MAX_SCRIPT_TEXT:
        raise ScriptLimitError(f"a text of more than {MAX_SCRIPT_TEXT:,} characters")
    if isinstance(result, list | tuple | dict) and len(result) > MAX_SCRIPT_ITEMS:
        raise ScriptLimitError(f"more than {MAX_SCRIPT_ITEMS:,} items")
    check_number(result)
    return result


def check_number(value: Any) -> None:
    """Check the length of an integer.

    Raises:
        ScriptLimitError: it is longer than the limit.
    """
    if isinstance(value, int) and value.bit_length() > MAX_SCRIPT_BITS:
        raise ScriptLimitError(f"a number of more than {MAX_SCRIPT_BITS} bits")


def _check_repetition(left: Any, right: Any) -> None:
    times, repeated = (left, right) if isinstance(left, int) else (right, left)
    is_repeated = isinstance(times, int) and isinstance(repeated, str | list | tuple)
    if is_repeated and times * len(repeated) > MAX_SCRIPT_ITEMS:
        raise ScriptLimitError(f"more than {MAX_SCRIPT_ITEMS:,} items")


def _range(*ends: int) -> list[int]:
    numbers = range(*ends)
    if len(numbers) > MAX_SCRIPT_ITEMS:
        raise ScriptLimitError(f"a range of more than {MAX_SCRIPT_ITEMS:,} numbers")
    return list(numbers)


def _as_text(value: Any) -> str:
    if isinstance(value, ImageSize):
        shown = f"({value.width},{value.height})"
        return f"{value.label} {shown}" if value.label else shown
    if isinstance(value, str | int | float | bool | list | tuple | dict) or value is None:
        return str(value)
    raise ValueError


def foreign_constant(name: str) -> ImageSize | None:
    """The value of an imported constant; None if it is not known here."""
    above, _, last = name.rpartition(".")
    return _SIZES.get(last) if above.endswith("ImageResolution") else None


def foreign_call(
    name: str,
    arguments: list[Any],
    keywords: dict[str, Any],
    place: Span,
    launch_values: Mapping[str, Any],
) -> Any:
    """The result of a call of something outside of the script: a construct if it is not known.

    Args:
        name: the full name of what is called.
        arguments: by position.
        keywords: by name.
        place: of the call.
        launch_values: what ``LaunchConfiguration(name)`` is, by name.

    Raises:
        NotKnownError: its arguments are not known, or not understood.
    """
    last = name.rpartition(".")[2]
    if last in _LAUNCH_VALUES:
        named = keywords.get("variable_name", keywords.get("launch_configuration_name"))
        configuration = arguments[0] if arguments else named
        others = [*arguments[1:], *keywords.values()] if arguments else list(keywords.values())[1:]
        known = launch_values.get(configuration) if isinstance(configuration, str) else None
        value = _launch_value(last, known, others)
        if value is not None:
            return value
    function = _CALLS.get(name) or _CALLS_BY_LAST.get(last)
    if function is None:
        return Construct(name, arguments, keywords, place)
    require_known(arguments, keywords)
    try:
        return function(*arguments, **keywords)
    except (TypeError, ValueError, IndexError, KeyError, AttributeError, ArithmeticError) as error:
        raise NotKnownError(f"the arguments of {last} are not understood") from error


def join_path(*parts: Any) -> str:
    """``os.path.join`` of texts.

    Raises:
        NotKnownError: a part is no text.
    """
    if not parts or not all(isinstance(part, str) for part in parts):
        raise NotKnownError("a part of the path is not a text")
    return str(posixpath.join(*parts))


def _launch_value(kind: str, value: Any, others: list[Any]) -> Any:
    """What a launch configuration is, or whether it equals a text; None if that is not known."""
    if kind == "LaunchConfiguration":
        value = value if value is not None or not others else others[0]
        if isinstance(value, list | tuple) and all(isinstance(part, str) for part in value):
            value = "".join(value)
        return LaunchText(value) if isinstance(value, str) else value
    if not others or not isinstance(value, str | bool | int | float):
        return None
    return (str(value) == str(others[0])) is (kind == "LaunchConfigurationEquals")


def _flattened(parts: tuple[Any, ...]) -> list[Any]:
    return [text for part in parts for text in (part if isinstance(part, list | tuple) else [part])]


def _of_text(call: Callable[[str], Any]) -> Callable[..., Any]:
    def result(path: Any, **_options: Any) -> Any:
        if not isinstance(path, str):
            raise NotKnownError("the argument is not a text")
        return call(path)

    return result


def environment_variable(name: Any, *default: Any, **keywords: Any) -> str:
    """An environment variable, as a reference.

    Raises:
        NotKnownError: its name is not known, or it has a default, which a reference has not.
    """
    if not isinstance(name, str):
        raise NotKnownError("no name")
    if name in _ENVIRONMENT:
        return _ENVIRONMENT[name]
    if any(value is not None for value in (*default, *keywords.values())):
        raise NotKnownError(f"the environment variable {name} decides it")
    return LaunchText(f"$(env {name})")


def _share(package: Any = None, *, package_name: Any = None, **_others: Any) -> str:
    name = "".join(_flattened((package if package_name is None else package_name,)))
    if not name:
        raise NotKnownError("no package")
    return LaunchText(f"$(share {name})")


def _copied(value: Any, *_memo: Any) -> Any:
    if isinstance(value, dict):
        return {key: _copied(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_copied(each) for each in value]
    return value


def _joined_parts(parts: Any) -> str:
    """A path of parts, each of which may be written in parts, too."""
    each = ["".join(part) if isinstance(part, list | tuple) else part for part in parts]
    return LaunchText(join_path(*each))


def _size(width: Any, height: Any, name: Any = "") -> ImageSize:
    return ImageSize(int(width), int(height), str(name))


_CALLS: Final[dict[str, Callable[..., Any]]] = {
    "os.path.join": join_path,
    "os.path.dirname": _of_text(
        lambda path: path if path == "$(script)" else posixpath.dirname(path)
    ),
    "os.path.basename": _of_text(posixpath.basename),
    "os.path.abspath": _of_text(str),
    "os.path.realpath": _of_text(str),
    "os.path.normpath": _of_text(posixpath.normpath),
    "os.path.splitext": _of_text(posixpath.splitext),
    "os.path.expandvars": _of_text(str),
    "os.getenv": environment_variable,
    "os.environ.get": environment_variable,
    "os.environ.copy": CopiedEnvironment,
    "launch.utilities.perform_substitutions": lambda _context, parts: "".join(_flattened((parts,))),
    "pathlib.Path": join_path,
    "copy.deepcopy": _copied,
    "copy.copy": _copied,
    "ros2_benchmark.ROS2BenchmarkTest.get_assets_root_path": lambda *_: ASSETS,
}
_CALLS_BY_LAST: Final[dict[str, Callable[..., Any]]] = {
    "get_package_share_directory": _share,
    "get_package_share_path": _share,
    "FindPackageShare": _share,
    "PathJoinSubstitution": _joined_parts,
    "PathSubstitution": lambda path: _joined_parts((path,)),
    "TextSubstitution": lambda text: LaunchText(text),
    "EnvironmentVariable": environment_variable,
    "Resolution": _size,
}


def is_file_test(value: Any) -> bool:
    """Whether a value is the result of ``os.path.isfile`` or a similar test."""
    return isinstance(value, Construct) and value.name in {
        "os.path.isfile",
        "os.path.exists",
        "os.path.isdir",
    }
