"""Stand-ins for what a script or a launch file imports and this process must not run.

A stand-in records how it is called, with the line of the file, and answers with another one. A text
that contains an unknown value has a mark such as ``$(unknown 3)``; what the machine decides has
marks, too: ``$(assets)``, ``$(share PACKAGE)``, ``$(env NAME)``. Where a program needs a truth or
a number of an unknown value, one is assumed and noted.

Modules of the file's own project, of Python and of other installed packages are the real ones.
"""

from __future__ import annotations

import ast
import builtins
import importlib.abc
import importlib.machinery
import importlib.util
import os
import sys
import types
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from r2bspec.interop.recording import Note, NoteKind, Place, Unknown

_STAND_INS: Final = frozenset(
    {
        *("ament_index_python", "isaac_ros_benchmark", "isaac_ros_ess", "launch", "launch_pal"),
        *("launch_param_builder", "launch_ros", "launch_testing", "launch_testing_ros"),
        *("launch_xml", "launch_yaml", "nav2_common", "moveit_configs_utils", "rclpy"),
        *("ros2_benchmark", "tf2_ros", "ros2_control_test_assets", "rosbag2_py"),
    }
)
_MESSAGES: Final = ("_msgs", "_interfaces", "_srvs")
_LEVELS_ABOVE: Final = 6
"""Folders above a file in which its project is looked for."""


class Recording:
    """What is recorded in this process.

    Attributes:
        main: the file that is executed.
        trees: the syntax trees of the files that are executed, by path.
        folders: where modules and packages of the project are looked for.
        unknown: what is not known.
        notes: in order, each once.
        shares: the package of each share folder that was asked for.
        answers: methods of stand-ins that have an answer, such as ``perform``.
        on_call: is told of each call.
    """

    def __init__(self, main: Path, package_paths: Sequence[Path]) -> None:
        self.main = main
        self.trees: dict[str, ast.Module] = {}
        self.folders = [*list(main.parents)[:_LEVELS_ABOVE], *package_paths]
        self.unknown: list[Unknown] = []
        self.notes: dict[Note, None] = {}
        self.shares: dict[str, str] = {}
        self.answers: dict[str, Callable[..., Any]] = {}
        self.on_call: Callable[[Recorded], None] = lambda _: None

    def note(self, kind: NoteKind, reason: str, place: Place | None = None) -> None:
        """Note something once."""
        self.notes[Note(kind, reason, place or self.place())] = None

    def places(self) -> Iterator[Place]:
        """Yield the lines of the project that are being executed, innermost first."""
        frame: types.FrameType | None = sys._getframe(1)
        while frame is not None:
            if frame.f_code.co_filename in self.trees:
                yield frame.f_code.co_filename, frame.f_lineno
            frame = frame.f_back

    def place(self) -> Place:
        """Return the line of the project that is being executed."""
        return next(self.places(), (str(self.main), 1))

    def mark(self, what: str, place: Place) -> str:
        """Return a text for something unknown."""
        unknown = Unknown(what, place)
        if unknown not in self.unknown:
            self.unknown.append(unknown)
        return f"$(unknown {self.unknown.index(unknown)})"

    def is_own(self, path: str) -> bool:
        """Return whether a path is in the project or in the share folder of a package."""
        top = self.folders[min(2, len(self.folders) - 1)]
        return path.startswith((f"{top}/", *(f"{share}/" for share in self.shares)))

    def share(self, package: str) -> str:
        """Return the share folder of a package: its source, where it is installed, or a mark."""
        from r2bspec.plan.installed_packages import package_share

        sources = (folder / package for folder in self.folders)
        source = next((each for each in sources if (each / "package.xml").is_file()), None)
        named = [each for each in self.folders if each.name == package]
        source = source or next((x for x in named if (x / "package.xml").is_file()), None)
        folder = source or package_share(package)
        if folder is None:
            return f"$(share {package})"
        self.shares[str(folder)] = package
        return str(folder)

    def execute(self, file: Path, name: str) -> types.ModuleType:
        """Execute a file as a module."""
        module = types.ModuleType(name)
        module.__file__ = str(file)
        sys.modules[name] = module
        self.execute_in(module, file)
        return module

    def execute_in(self, module: types.ModuleType, file: Path) -> None:
        """Execute a file in a module."""
        text = file.read_bytes()
        self.trees[str(file)] = tree = ast.parse(text, str(file))
        code = compile(tree, str(file), "exec")
        exec(code, module.__dict__)  # noqa: S102 - it is what the user has asked for


RECORDING: Recording
"""That of this process; `start` makes it."""


class Recorded:
    """A call, an attribute or an item of something that a stand-in does not know."""

    def __init__(
        self,
        name: str,
        args: tuple[Any, ...] = (),
        kwargs: dict[str, Any] | None = None,
        owner: Recorded | None = None,
        *,
        called: bool = False,
    ) -> None:
        fields: dict[str, Any] = {"name": name, "args": args, "kwargs": kwargs or {}}
        fields |= {"owner": owner} | {"called": called, "place": RECORDING.place(), "children": {}}
        self.__dict__.update({f"_{key}": value for key, value in fields.items()})

    @property
    def _kind(self) -> str:
        return str(self._name).rpartition(".")[2]

    def _get(self, key: str, position: int | None = None, default: Any = None) -> Any:
        if key in self._kwargs:
            return self._kwargs[key]
        is_given = position is not None and position < len(self._args)
        return self._args[position] if is_given else default

    def _what(self) -> str:
        """Return what it is, in words."""
        first: Recorded = self
        while first._owner is not None:
            first = first._owner
        if first._name == "open":
            return "the content of a file"
        return f"the result of {self._name}()" if self._called else f"the value of {self._name}"

    def _is_instance(self) -> bool:
        """Return whether it is made by a call, or a part of what is."""
        return self._called or (self._owner is not None and self._owner._is_instance())

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        if name in self._kwargs:
            return self._kwargs[name]
        if name in RECORDING.answers:
            return lambda *args, **kwargs: RECORDING.answers[name](self, *args, **kwargs)
        return self._children.setdefault(name, Recorded(f"{self._name}.{name}", owner=self))

    def __setattr__(self, name: str, value: Any) -> None:
        self._kwargs[name] = value

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Record a call."""
        made = Recorded(self._name, args, kwargs, self._owner, called=True)
        RECORDING.on_call(made)
        return made

    def __getitem__(self, key: Any) -> Recorded:
        return Recorded(f"{self._name}[{key!r}]", owner=self)

    def __setitem__(self, key: Any, value: Any) -> None:
        self._kwargs[str(key)] = value

    def __mro_entries__(self, _bases: tuple[Any, ...]) -> tuple[type, ...]:
        return (StandIn,)

    def __instancecheck__(self, instance: Any) -> bool:
        return isinstance(instance, Recorded) and instance._name == self._name

    def __str__(self) -> str:
        return RECORDING.mark(self._what(), self._place)

    __fspath__ = __str__

    def __format__(self, _spec: str) -> str:
        return str(self)

    def __enter__(self) -> Recorded:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def _assume(self, value: Any, how: str) -> Any:
        RECORDING.note("lost", f"{self._what()} is not known; {how}")
        return value

    def __iter__(self) -> Iterator[Any]:
        return iter(self._assume((), "it is taken as empty"))

    def __len__(self) -> int:
        return int(self._assume(0, "it is taken as empty"))

    def __contains__(self, _: object) -> bool:
        return bool(self._assume(False, "it is taken as empty"))

    def __bool__(self) -> bool:
        return bool(self._assume(True, "it is taken as true"))

    def __int__(self) -> int:
        return int(self._assume(1, "the number 1 is used for it"))

    __index__ = __int__

    def __float__(self) -> float:
        return float(int(self))

    def __eq__(self, other: object) -> bool:
        return self is other or bool(self._assume(False, "it is taken as another value"))

    __hash__ = object.__hash__


def _operation(name: str) -> Callable[[Recorded, Any], Recorded]:
    return lambda left, right: Recorded(name, (left, right), called=True)


def _reversed(name: str) -> Callable[[Recorded, Any], Recorded]:
    return lambda right, left: Recorded(name, (left, right), called=True)


for _name in ("add", "sub", "mul", "truediv", "floordiv", "mod", "pow", "or", "and"):
    setattr(Recorded, f"__{_name}__", _operation(_name))
    setattr(Recorded, f"__r{_name}__", _reversed(_name))
for _name in ("lt", "le", "gt", "ge"):
    setattr(Recorded, f"__{_name}__", lambda self, _: self._assume(False, "it is taken as false"))


class _StandInType(type):
    def __getattr__(cls, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return Recorded(f"{cls.__name__}.{name}")


class StandIn(metaclass=_StandInType):
    """The base of classes that are derived from a stand-in."""

    def __init__(self, *_args: Any, **_kwargs: Any) -> None:
        pass

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return Recorded(f"{type(self).__name__}.{name}")


class BenchmarkTest(StandIn):
    """``ros2_benchmark.ROS2BenchmarkTest``, as far as scripts use it."""

    config: Any = None

    @classmethod
    def generate_namespace(cls, *names: str) -> str:
        """Return the namespace of the benchmark, or a name inside of it."""
        space = (
            cls.config._get("benchmark_namespace", default="r2b")
            if cls.config is not None
            else "r2b"
        )
        return "/".join((f"/{str(space).strip('/')}", *map(str, names)))

    @classmethod
    def get_assets_root_path(cls, *_: Any) -> str:
        """Return the folder of data and models."""
        return "$(assets)"

    @classmethod
    def generate_test_description_with_nsys(cls, setup: Any, *_: Any, **__: Any) -> Any:
        """Return the launch actions, to which the tool itself would add."""
        if not callable(setup) or isinstance(setup, Recorded):
            return setup
        number = setup.__code__.co_argcount
        context = [Recorded("launch.LaunchContext")] if number > 2 else []
        return setup(*[*context, "", "5"][:number])

    generate_test_description = generate_test_description_with_nsys


class Size(dict[str, int]):
    """``ros2_benchmark.Resolution``: width and height in pixels."""

    def __init__(self, width: int, height: int, name: str = "") -> None:
        super().__init__(width=width, height=height)
        self.name = name


class _Sizes:
    """``ros2_benchmark.ImageResolution``."""

    QUARTER_HD = Size(960, 540, "Quarter HD")
    VGA = Size(640, 480, "VGA")
    WVGA = Size(720, 480, "WVGA")
    HD = Size(1280, 720, "HD")
    FULL_HD = Size(1920, 1080, "Full HD")
    WUXGA = Size(1920, 1200, "WUXGA")
    FOUR_K = Size(3840, 2160, "4K")


_KNOWN: Final[dict[str, Any]] = {
    "ROS2BenchmarkTest": BenchmarkTest,
    "Resolution": Size,
    "ImageResolution": _Sizes,
    "get_package_share_directory": lambda package, *_: RECORDING.share(package),
    "get_package_share_path": lambda package, *_: Path(RECORDING.share(package)),
    "get_package_prefix": lambda package: f"{RECORDING.share(package)}/../..",
}
"""What a stand-in knows."""


class _Module(types.ModuleType):
    """A module that has every name."""

    def __getattr__(self, name: str) -> Any:
        if name == "__all__":
            return _names_without_source(RECORDING.trees[RECORDING.place()[0]])
        if name.startswith("__"):
            raise AttributeError(name)
        if name in _KNOWN:
            return _KNOWN[name]
        if name.endswith(("Error", "Exception")):
            return type(name, (Exception,), {})
        return Recorded(f"{self.__name__}.{name}")


def _names_without_source(tree: ast.Module) -> list[str]:
    """Return the classes that a file uses and does not define: ``import *`` may give them."""
    nodes = list(ast.walk(tree))
    used = {node.id for node in nodes if isinstance(node, ast.Name) and node.id[:1].isupper()}
    defined = {node.name for node in nodes if isinstance(node, ast.ClassDef)}
    imported = (node.names for node in nodes if isinstance(node, ast.ImportFrom | ast.Import))
    named = {alias.asname or alias.name for aliases in imported for alias in aliases}
    return sorted(used - defined - named - vars(builtins).keys())


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    def find_spec(
        self, name: str, _path: Any = None, _target: Any = None
    ) -> importlib.machinery.ModuleSpec | None:
        top = name.partition(".")[0]
        if top in sys.stdlib_module_names or top == "r2bspec":
            return None
        if top not in _STAND_INS or top == "isaac_ros_benchmark":
            if (file := self._own(name)) is not None:
                kind = _OwnLoader(file)
                is_package = file.name == "__init__.py"
                return importlib.util.spec_from_loader(name, kind, is_package=is_package)
            if top not in _STAND_INS and not top.endswith(_MESSAGES) and _is_installed(top):
                return None
        return importlib.machinery.ModuleSpec(name, self, is_package=True)

    @staticmethod
    def _own(name: str) -> Path | None:
        """Return the file of a module that lies beside another file, or in a package above that."""
        parts = name.split(".")
        for folder in RECORDING.folders:
            for above in (folder, folder / parts[0]):
                module = above.joinpath(*parts)
                for file in (module / "__init__.py", module.with_suffix(".py")):
                    if file.is_file() and file != RECORDING.main:
                        return file
        return None

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> types.ModuleType:
        return _Module(spec.name)

    def exec_module(self, module: types.ModuleType) -> None:
        module.__path__ = []


def _is_installed(top: str) -> bool:
    return importlib.machinery.PathFinder.find_spec(top) is not None


class _OwnLoader(importlib.abc.Loader):
    """Loads a module of the project."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def create_module(self, _spec: importlib.machinery.ModuleSpec) -> None:
        return None

    def exec_module(self, module: types.ModuleType) -> None:
        module.__file__ = str(self.file)
        RECORDING.execute_in(module, self.file)


class CopiedEnvironment(dict[str, str]):
    """A copy of ``os.environ`` that keeps changes; other variables stay on this machine."""

    def __missing__(self, name: str) -> str:
        return f"$(env {name})"


class _Environment(dict[str, str]):
    """``os.environ``: for the project's own code, a variable is a mark or its default."""

    def __iter__(self) -> Iterator[str]:
        return iter(()) if asks_itself() else super().__iter__()

    def keys(self) -> Any:
        """No names, as they and their values are no matter of a spec."""
        return {}.keys() if asks_itself() else super().keys()

    def items(self) -> Any:
        """No variables, for the same reason."""
        return {}.items() if asks_itself() else super().items()

    def copy(self) -> dict[str, str]:
        """Return an environment that is known as a copy."""
        return CopiedEnvironment() if asks_itself() else super().copy()

    def __getitem__(self, name: str) -> str:
        return f"$(env {name})" if asks_itself() else super().__getitem__(name)

    def get(self, name: str, default: Any = None) -> Any:
        """Return the default, if there is one: the variable is a matter of the machine."""
        if not asks_itself():
            return super().get(name, default)
        if default is None:
            return f"$(env {name})"
        reason = f"the environment variable {name!r} has its default {default!r} here"
        RECORDING.note("changed", reason)
        return default


def asks_itself() -> bool:
    """Return True if the caller of the calling function is code of the project."""
    return sys._getframe(2).f_code.co_filename in RECORDING.trees


def _unknown_of(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a parser that passes on what is not known."""

    def parse(source: Any, *args: Any, **kwargs: Any) -> Any:
        if isinstance(source, Recorded):
            return Recorded(source._name, owner=source, called=True)
        return function(source, *args, **kwargs)

    return parse


def start(main: Path, package_paths: Sequence[Path]) -> Recording:
    """Install the stand-ins for the rest of this process."""
    import json

    import yaml

    global RECORDING
    RECORDING = Recording(main, package_paths)
    sys.meta_path.insert(0, _Finder())
    for name in [name for name in sys.modules if name.partition(".")[0] in _STAND_INS]:
        del sys.modules[name]
    for module, names in ((yaml, ("load", "safe_load")), (json, ("load", "loads"))):
        for name in names:
            setattr(module, name, _unknown_of(getattr(module, name)))
    environment = _Environment(os.environ)
    os.environ = environment  # type: ignore[assignment] # noqa: B003 - only read from here on
    os.getenv = environment.get  # type: ignore[assignment]
    return RECORDING
