"""Writes the modules that a Python program has imported when it exits.

The kernel does not know them: sources are read and not mapped. Python imports a module of this name
when it starts, and this folder is the last in the ``PYTHONPATH`` of the processes of a graph. Of
all ways to see what a program has imported this is the one that cannot break it:

- Its command, its interpreter and its ``sys.path`` stay as they are: this folder is removed again.
- A ``sitecustomize`` that the user or the system has is imported as it would be without this one.
- Nothing happens while the program runs, and nothing that fails here is seen by it.

A program that is killed, or started with ``-E`` or ``-I``, names nothing; the run says so. Any
version of Python may read this file, so it uses nothing but what all of them have.
"""

# mypy: ignore-errors
import atexit
import os
import sys

try:
    _BEGAN_IN = os.getcwd()
except OSError:
    _BEGAN_IN = os.sep
_FOLDER = os.path.dirname(os.path.abspath(__file__))


def _name_modules(folder=os.environ.get("R2BSPEC_MODULES_FOLDER", "")):
    try:
        names = set()
        for module in list(sys.modules.values()):
            try:
                # Not by `getattr`, which would load a module that is imported lazily.
                values = object.__getattribute__(module, "__dict__")
            except Exception:
                continue
            # That of the program itself has lost its file, but not its loader.
            name = values.get("__file__") or getattr(values.get("__loader__"), "path", None)
            if isinstance(name, str):
                names.add(os.path.join(_BEGAN_IN, name))
        try:
            os.mkdir(folder)
        except OSError:
            pass
        # Wrappers and launch files have the session of the process that the run has started.
        path = os.path.join(folder, "%d-%d" % (os.getsid(0), os.getpid()))
        with open(path, "wb") as file:
            file.write("\0".join(sorted(names)).encode("utf-8", "surrogateescape"))
    except Exception:
        pass


def _import_next():  # type: ignore[no-untyped-def]
    sys.path[:] = [entry for entry in sys.path if entry != _FOLDER]
    own = sys.modules.pop("sitecustomize", None)
    try:
        import sitecustomize
    except ImportError as error:
        if getattr(error, "name", "sitecustomize") != "sitecustomize":
            raise
    finally:
        # The import of this one ends with what is in the table.
        if own is not None:
            sys.modules.setdefault("sitecustomize", own)


atexit.register(_name_modules)
_import_next()
