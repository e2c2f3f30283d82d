"""The forms that names and references take, each with the words for one that is wrong."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class NamePattern:
    """A regular expression in the subset that Python and JavaScript share, and what it means.

    Attributes:
        noun: what a text of this form is called.
        message: how such a text is written.
    """

    pattern: str
    noun: str
    message: str


_TOKEN = "[A-Za-z_][A-Za-z0-9_]*"  # noqa: S105 - of a ROS name, not a secret
_TOKENS = f"{_TOKEN}(?:/{_TOKEN})*"

TOPIC = NamePattern(
    f"^(?:~|(?:~?/)?{_TOKENS})$",
    "topic",
    "a topic is made of letters, digits and underscores, separated by single slashes; no part "
    "begins with a digit, and no slash stands at the end",
)
NAMESPACE = NamePattern(
    f"^(?:/|/?{_TOKENS})$",
    "namespace",
    "a namespace is made of letters, digits and underscores, separated by single slashes; no "
    "part begins with a digit",
)
NODE_NAME = NamePattern(
    f"^{_TOKEN}$",
    "node name",
    "a node's name is made of letters, digits and underscores, and does not begin with a digit",
)
MONITOR_NAME = NamePattern(
    "^[A-Za-z][A-Za-z0-9_]*$",
    "monitor name",
    "a monitor's name begins with a letter and goes on with letters, digits and underscores, so "
    "that requirements can use it",
)
NAME = NamePattern(
    "^[A-Za-z][A-Za-z0-9_-]*$",
    "name",
    "a name begins with a letter and goes on with letters, digits, underscores and dashes",
)
VARIABLE = NamePattern(
    f"^{_TOKEN}$",
    "variable name",
    "a variable's name is made of letters, digits and underscores, and does not begin with a digit",
)
ENVIRONMENT = NamePattern(
    f"^{_TOKEN}$",
    "name of an environment variable",
    "an environment variable's name is made of letters, digits and underscores, and does not "
    "begin with a digit",
)
PARAMETER = NamePattern(
    "^[A-Za-z_][A-Za-z0-9_./-]*$",
    "parameter name",
    "a parameter's name begins with a letter; its parts are separated by dots",
)
LABEL_KEY = NamePattern(
    "^[A-Za-z_][A-Za-z0-9_.-]*$",
    "label",
    "a label begins with a letter and goes on with letters, digits, underscores, dots and dashes",
)
MESSAGE_TYPE = NamePattern(
    "^[A-Za-z][A-Za-z0-9_]*/msg/[A-Z][A-Za-z0-9]*$",
    "message type",
    "a message type is written package/msg/Name, such as sensor_msgs/msg/Image",
)
PYTHON_NODE = NamePattern(
    r"^(?:[A-Za-z_][A-Za-z0-9_]*(?:\.[A-Za-z_][A-Za-z0-9_]*)+|[^:]+\.py:[A-Za-z_][A-Za-z0-9_]*)$",
    "Python node",
    "a Python node is written module.Class, or ./file.py:Class relative to this file",
)
PLUGIN = NamePattern(
    r"^[A-Za-z_][A-Za-z0-9_]*(?:::[A-Za-z_][A-Za-z0-9_]*)*$",
    "plugin",
    "a plugin is the name of a C++ class with its namespaces, such as image_proc::ResizeNode",
)
INSTANCE = NamePattern(
    "^[A-Za-z0-9_]+$",
    "instance name",
    "an instance's name is made of letters, digits and underscores; it is appended to the name "
    "that is repeated",
)
SERVICE_TYPE = NamePattern(
    "^[A-Za-z][A-Za-z0-9_]*/srv/[A-Z][A-Za-z0-9]*$",
    "service type",
    "a service type is written package/srv/Name, such as std_srvs/srv/SetBool",
)
PACKAGE = NamePattern(
    "^[A-Za-z][A-Za-z0-9_-]*$",
    "package name",
    "a package's name begins with a letter and goes on with letters, digits, underscores and "
    "dashes",
)
FILE_NAME = NamePattern("^[^/]+$", "executable name", "an executable is named without its folder")
DATASET = NamePattern(
    "^[A-Za-z0-9][A-Za-z0-9_.-]*$",
    "dataset name",
    "a dataset's name is made of letters, digits, underscores, dots and dashes; a path goes "
    "under 'path'",
)
SHA256 = NamePattern(
    "^[0-9a-f]{64}$", "SHA-256 digest", "a SHA-256 digest is 64 digits, 0 to 9 and a to f"
)
NOT_EMPTY = NamePattern(r"\S", "path", "this must not be empty")
SOME_TEXT = NamePattern(r"\S", "text", "this must not be empty")
