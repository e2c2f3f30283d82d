"""The types of names and references: their patterns, and messages for invalid names.

A type such as `Topic` is an ordinary string outside of the language, where it has its pattern.
"""

from typing import Annotated

from r2bspec.language.declaration import NamePattern

_PART = "[A-Za-z_][A-Za-z0-9_]*"
_PARTS = f"{_PART}(?:/{_PART})*"


def _identifier(noun: str, of: str) -> NamePattern:
    message = f"the name of {of} consists of letters, digits and underscores, and does not begin "
    return NamePattern(f"^{_PART}$", noun, f"{message}with a digit")


def _interface(noun: str, folder: str, example: str) -> NamePattern:
    """Return a type of messages, services or actions, of which packages have a folder each."""
    pattern = f"^[A-Za-z][A-Za-z0-9_]*/{folder}/[A-Z][A-Za-z0-9]*$"
    article = "an" if noun[0] in "aeiou" else "a"
    message = f"{article} {noun} has the form package/{folder}/Name, such as {example}"
    return NamePattern(pattern, noun, message)


TOPIC = NamePattern(
    f"^(?:~|(?:~?/)?{_PARTS})$",
    "topic",
    "a topic consists of letters, digits and underscores, separated by single slashes; no part "
    "begins with a digit, and it does not end with a slash",
)
GRAPH_TOPIC = NamePattern(
    f"^/?{_PARTS}$",
    "topic",
    "a topic outside of a node consists of letters, digits and underscores, separated by single "
    "slashes; no part begins with a digit, and only a node has topics that begin with '~'",
)
NAMESPACE = NamePattern(
    f"^(?:/|/?{_PARTS})$",
    "namespace",
    "a namespace consists of letters, digits and underscores, separated by single slashes; no "
    "part begins with a digit",
)
NODE_NAME = _identifier("node name", "a node")
MONITOR_NAME = NamePattern(
    "^[A-Za-z][A-Za-z0-9_]*$",
    "monitor name",
    "the name of a monitor consists of letters, digits and underscores, and begins with a letter, "
    "so that requirements can use it",
)
NAME = NamePattern(
    "^[A-Za-z][A-Za-z0-9_-]*$",
    "name",
    "a name consists of letters, digits, underscores and dashes, and begins with a letter",
)
VARIABLE = _identifier("variable name", "a variable")
ENVIRONMENT = _identifier("environment variable name", "an environment variable")
PARAMETER = NamePattern(
    "^[A-Za-z_][A-Za-z0-9_./-]*$",
    "parameter name",
    "the name of a parameter begins with a letter; its parts are separated by dots",
)
LABEL_KEY = NamePattern(
    "^[A-Za-z_][A-Za-z0-9_.-]*$",
    "label",
    "a label consists of letters, digits, underscores, dots and dashes, and begins with a letter",
)
MESSAGE_TYPE = _interface("message type", "msg", "sensor_msgs/msg/Image")
SERVICE_TYPE = _interface("service type", "srv", "std_srvs/srv/SetBool")
ACTION_TYPE = _interface("action type", "action", "nav2_msgs/action/ComputePathToPose")
PYTHON_NODE = NamePattern(
    r"^(?:[A-Za-z_][A-Za-z0-9_]*(?:\.[A-Za-z_][A-Za-z0-9_]*)+|[^:]+\.py:[A-Za-z_][A-Za-z0-9_]*)$",
    "Python node",
    "a Python node has the form module.Class, or ./file.py:Class",
)
PLUGIN = NamePattern(
    r"^[A-Za-z_][A-Za-z0-9_]*(?:::[A-Za-z_][A-Za-z0-9_]*)*$",
    "plugin",
    "a plugin is the name of a C++ class with its namespaces, such as image_proc::ResizeNode",
)
PACKAGE = NamePattern(
    "^[A-Za-z][A-Za-z0-9_-]*$",
    "package name",
    "the name of a package consists of letters, digits, underscores and dashes, and begins with a "
    "letter",
)
PLACE = NamePattern(
    "^[^/]+(?:/[^/]+)?$", "process", "it is the name of a node or a process, or NODE/PROGRAM"
)
FILE_NAME = NamePattern("^[^/]+$", "executable name", "the name of an executable has no folder")
DATASET = NamePattern(
    "^[A-Za-z0-9][A-Za-z0-9_.-]*$",
    "dataset name",
    "the name of a dataset consists of letters, digits, underscores, dots and dashes; use 'path' "
    "for a path",
)
SHA256 = NamePattern(
    "^[0-9a-f]{64}$", "SHA-256 digest", "a SHA-256 digest has 64 hexadecimal digits, 0-9 and a-f"
)
NOT_EMPTY = NamePattern(r"\S", "path", "the path must not be empty")
SOME_TEXT = NamePattern(r"\S", "text", "the text must not be empty")

Topic = Annotated[str, TOPIC]
GraphTopic = Annotated[str, GRAPH_TOPIC]
Namespace = Annotated[str, NAMESPACE]
NodeName = Annotated[str, NODE_NAME]
MonitorName = Annotated[str, MONITOR_NAME]
Name = Annotated[str, NAME]
VariableName = Annotated[str, VARIABLE]
EnvironmentName = Annotated[str, ENVIRONMENT]
ParameterName = Annotated[str, PARAMETER]
LabelName = Annotated[str, LABEL_KEY]
MessageType = Annotated[str, MESSAGE_TYPE]
ServiceType = Annotated[str, SERVICE_TYPE]
ActionType = Annotated[str, ACTION_TYPE]
PackageName = Annotated[str, PACKAGE]
ProcessName = Annotated[str, PLACE]
FilePath = Annotated[str, NOT_EMPTY]
SomeText = Annotated[str, SOME_TEXT]
