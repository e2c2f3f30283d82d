"""R2B101 to R2B119 and R2B150: invalid keys and values."""

from __future__ import annotations

from r2bspec.diagnostics.code_pages import Page
from r2bspec.diagnostics.diagnostic import Severity


def _page(slug: str, code: str, title: str, why: str, failing: str, passing: str) -> Page:
    return Page(slug, code, title, Severity.ERROR, why, failing, passing)


SCHEMA_PAGES = (
    _page(
        "unknown-key",
        "R2B101",
        "an unknown key",
        "An unknown key would have no effect. Usually it is a typo, or at the wrong level. Keys "
        "that begin with x- are ignored, and can hold notes and anchors.",
        "benchmark: {durration: 10 s}\n",
        "benchmark: {duration: 10 s}\n",
    ),
    _page(
        "missing-key",
        "R2B102",
        "a missing key",
        "The key is required: no default would fit most benchmarks.",
        "monitors:\n  detections: {topic: tag_detections}\n",
        "monitors:\n  detections: {topic: tag_detections, format: geometry_msgs/msg/PoseArray}\n",
    ),
    _page(
        "wrong-type",
        "R2B103",
        "a value of the wrong type",
        "Types are not converted. YAML reads an unquoted 720 as a number; quote it if it is a "
        "string.",
        "benchmark: {rates: 10 Hz}\n",
        "benchmark: {rates: [10 Hz]}\n",
    ),
    _page(
        "unknown-choice",
        "R2B104",
        "an unknown choice",
        "The key accepts only the choices that the message lists.",
        "playback: {mode: loop}\n",
        "playback: {mode: looping}\n",
    ),
    _page(
        "malformed-text",
        "R2B105",
        "text of the wrong form",
        "Topics, types and names follow the rules of ROS, which would refuse the text when the "
        "graph starts.",
        "monitors:\n  detections: {topic: tags, format: geometry_msgs/PoseArray}\n",
        "monitors:\n  detections: {topic: tags, format: geometry_msgs/msg/PoseArray}\n",
    ),
    _page(
        "invalid-name",
        "R2B106",
        "an invalid name",
        "Names of nodes and topics follow the rules of ROS. Names of monitors, objectives and "
        "variables are used in requirements and references.",
        "monitors:\n  my-tags: {topic: tags, format: geometry_msgs/msg/PoseArray}\n",
        "monitors:\n  my_tags: {topic: tags, format: geometry_msgs/msg/PoseArray}\n",
    ),
    _page(
        "number-out-of-range",
        "R2B107",
        "a number out of range",
        "The message gives the minimum or the maximum.",
        "benchmark: {iterations: 0}\n",
        "benchmark: {iterations: 1}\n",
    ),
    _page(
        "empty-value",
        "R2B108",
        "an empty value",
        "The string, the list or the map must not be empty.",
        "monitors: {}\n",
        "monitors:\n  detections: {topic: tags, format: geometry_msgs/msg/PoseArray}\n",
    ),
    _page(
        "missing-unit",
        "R2B109",
        "a quantity without a unit",
        "Without a unit, 10 could be seconds or milliseconds.",
        "benchmark: {duration: 10}\n",
        "benchmark: {duration: 10 s}\n",
    ),
    _page(
        "invalid-quantity",
        "R2B110",
        "an invalid quantity",
        "A quantity is a number and a unit of the right kind: 10 s, 30 Hz, 2 %, 64 MiB.",
        "benchmark: {duration: ten seconds}\n",
        "benchmark: {duration: 10 s}\n",
    ),
    _page(
        "zero-quantity",
        "R2B111",
        "a quantity that must be more than zero",
        "Nothing can be played in zero seconds or at zero hertz.",
        "benchmark: {duration: 0 s}\n",
        "benchmark: {duration: 10 s}\n",
    ),
    _page(
        "invalid-requirement",
        "R2B112",
        "an invalid requirement",
        "A requirement has the form 'metric op bound', such as latency.p99 < 50 ms or drop_rate <= "
        "0.5 %, or is the word sustained. The caret shows the first error.",
        "slos:\n  fast: {at: 30 Hz, require: [latency.p99 below 50 ms]}\n",
        "slos:\n  fast: {at: 30 Hz, require: [latency.p99 < 50 ms]}\n",
    ),
    _page(
        "ambiguous-node-kind",
        "R2B113",
        "a node without exactly one kind",
        "A node is a Python class or function (python), a composable C++ node (package and "
        "plugin), an executable of a package (package and executable), any program (command), a "
        "launch file (launch), or a node that is already running (external).",
        "graph:\n  nodes:\n    detector: {python: my.Detector, command: [./detector]}\n",
        "graph:\n  nodes:\n    detector: {python: my.Detector}\n",
    ),
    _page(
        "ambiguous-bag-source",
        "R2B114",
        "a recording without exactly one source",
        "A recording is either the name of a dataset or a path. Several recordings are listed "
        "under 'bags'.",
        "data_loader: {bag: {dataset: r2b_storage, path: ./bag}}\n",
        "data_loader: {bag: {path: ./bag}}\n",
    ),
    _page(
        "unsupported-language-version",
        "R2B115",
        "an unsupported version of the language",
        "The version changes when the meaning of existing documents changes.",
        "r2bspec: 2\n",
        "r2bspec: 1\n",
    ),
    _page(
        "key-without-value",
        "R2B116",
        "a key without a value",
        "YAML reads a missing value as null, which is not a valid value. Omit the key to use its "
        "default.",
        "benchmark:\n  rates:\n",
        "benchmark:\n  rates: [30 Hz]\n",
    ),
    _page(
        "missing-name",
        "R2B117",
        "an entry without a name",
        "Named entries are maps from names to entries. Messages, --set and results use the names.",
        "monitors: {topic: tags, format: geometry_msgs/msg/PoseArray}\n",
        "monitors:\n  detections: {topic: tags, format: geometry_msgs/msg/PoseArray}\n",
    ),
    _page(
        "not-exactly-one-key",
        "R2B118",
        "not exactly one of several keys",
        "A readiness probe, a step, a launch file and a range of rates need exactly one of several "
        "keys. Two of them would contradict each other.",
        "ready:\n  model: {file: model.plan, topic: detector/status}\n",
        "ready:\n  model: {file: model.plan}\n",
    ),
    _page(
        "key-without-effect",
        "R2B119",
        "a key without effect",
        "The key is valid, but another key of the document makes it ineffective or contradicts it.",
        "playback: {mode: looping, timeline: {speed: 50 %}}\n",
        "playback: {mode: timeline, timeline: {speed: 50 %}}\n",
    ),
    _page(
        "swapped-keys",
        "R2B150",
        "two keys have each other's content",
        "Each of the two values is invalid under its key and valid under the other, so the keys "
        "were swapped.",
        "monitors: {duration: 10 s}\n"
        "benchmark: {tags: {topic: tags, format: geometry_msgs/msg/PoseArray}}\n",
        "benchmark: {duration: 10 s}\n"
        "monitors: {tags: {topic: tags, format: geometry_msgs/msg/PoseArray}}\n",
    ),
)
