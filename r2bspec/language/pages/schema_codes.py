"""R2B100 to R2B119: keys and values that the language does not know."""

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
        "A key that nobody reads is a wish that nobody fulfils: most often it is misspelt, or "
        "stands at the wrong level. Keys that begin with x- are free for notes and anchors.",
        "benchmark: {durration: 10 s}\n",
        "benchmark: {duration: 10 s}\n",
    ),
    _page(
        "missing-key",
        "R2B102",
        "a key is missing",
        "The language has defaults where one is right for nearly everybody; for the rest, a "
        "guess would measure something else than what was meant.",
        "monitors:\n  detections: {topic: tag_detections}\n",
        "monitors:\n  detections: {topic: tag_detections, format: geometry_msgs/msg/PoseArray}\n",
    ),
    _page(
        "wrong-type",
        "R2B103",
        "a value of the wrong type",
        "Text, numbers, truth values, lists and maps are not turned into one another: what YAML "
        "takes for a number is often meant as text, and the other way round.",
        "benchmark: {rates: 10 Hz}\n",
        "benchmark: {rates: [10 Hz]}\n",
    ),
    _page(
        "unknown-choice",
        "R2B104",
        "a word that is not among the choices",
        "The message lists all words that are known there.",
        "playback: {mode: loop}\n",
        "playback: {mode: looping}\n",
    ),
    _page(
        "malformed-text",
        "R2B105",
        "text of a wrong form",
        "Topics, types and names follow ROS's own rules; ROS would refuse the text when the "
        "graph starts.",
        "monitors:\n  detections: {topic: tags, format: geometry_msgs/PoseArray}\n",
        "monitors:\n  detections: {topic: tags, format: geometry_msgs/msg/PoseArray}\n",
    ),
    _page(
        "invalid-name",
        "R2B106",
        "a name that cannot be used",
        "Nodes and topics follow ROS's rules; monitors, objectives and variables must be usable "
        "in requirements and references.",
        "monitors:\n  my-tags: {topic: tags, format: geometry_msgs/msg/PoseArray}\n",
        "monitors:\n  my_tags: {topic: tags, format: geometry_msgs/msg/PoseArray}\n",
    ),
    _page(
        "number-out-of-range",
        "R2B107",
        "a number out of range",
        "The message tells the least, or the greatest, number that makes sense.",
        "benchmark: {iterations: 0}\n",
        "benchmark: {iterations: 1}\n",
    ),
    _page(
        "empty-value",
        "R2B108",
        "nothing where something must be",
        "A list or a map that must have an entry to mean anything.",
        "monitors: {}\n",
        "monitors:\n  detections: {topic: tags, format: geometry_msgs/msg/PoseArray}\n",
    ),
    _page(
        "missing-unit",
        "R2B109",
        "a quantity without a unit",
        "10 could be seconds or milliseconds; the reader of a spec should not have to know.",
        "benchmark: {duration: 10}\n",
        "benchmark: {duration: 10 s}\n",
    ),
    _page(
        "invalid-quantity",
        "R2B110",
        "text that is no quantity",
        "A quantity is a number and a unit of the right kind: 10 s, 30 Hz, 2 %, 64 MiB.",
        "benchmark: {duration: ten seconds}\n",
        "benchmark: {duration: 10 s}\n",
    ),
    _page(
        "zero-quantity",
        "R2B111",
        "a quantity of nothing",
        "No message is ever played in zero seconds or at zero hertz.",
        "benchmark: {duration: 0 s}\n",
        "benchmark: {duration: 10 s}\n",
    ),
    _page(
        "invalid-requirement",
        "R2B112",
        "text that is no requirement",
        "A requirement reads 'metric op bound', such as latency.p99 < 50 ms or drop_rate <= 0.5 "
        "%; or it is the word sustained. The caret shows where the sentence breaks.",
        "slos:\n  fast: {at: 30 Hz, require: [latency.p99 below 50 ms]}\n",
        "slos:\n  fast: {at: 30 Hz, require: [latency.p99 < 50 ms]}\n",
    ),
    _page(
        "ambiguous-node-kind",
        "R2B113",
        "a node that is not exactly one kind of node",
        "A node is a Python class or function (python), a composable C++ node (package and "
        "plugin), an executable of a package (package and executable), any program (command), what "
        "a launch file starts (launch), or something that runs already (external).",
        "graph:\n  nodes:\n    detector: {python: my.Detector, command: [./detector]}\n",
        "graph:\n  nodes:\n    detector: {python: my.Detector}\n",
    ),
    _page(
        "ambiguous-bag-source",
        "R2B114",
        "a bag that is not exactly one source",
        "A recording is a dataset, known by name, or a path; several stand under 'bags'.",
        "data_loader: {bag: {dataset: r2b_storage, path: ./bag}}\n",
        "data_loader: {bag: {path: ./bag}}\n",
    ),
    _page(
        "unsupported-language-version",
        "R2B115",
        "a version of the language that is not known",
        "The number changes when a document would mean something else than before.",
        "r2bspec: 2\n",
        "r2bspec: 1\n",
    ),
    _page(
        "key-without-value",
        "R2B116",
        "a key without a value",
        "YAML reads it as null, which no setting of the language means. A key that is left out "
        "has its default.",
        "benchmark:\n  rates:\n",
        "benchmark:\n  rates: [30 Hz]\n",
    ),
    _page(
        "missing-name",
        "R2B117",
        "the name is missing above an entry",
        "Everything that has a name is a map keyed by that name, so that messages, --set and "
        "results can address it.",
        "monitors: {topic: tags, format: geometry_msgs/msg/PoseArray}\n",
        "monitors:\n  detections: {topic: tags, format: geometry_msgs/msg/PoseArray}\n",
    ),
    _page(
        "not-exactly-one-key",
        "R2B118",
        "exactly one of several keys must be given",
        "A ready probe, a step and a launch file are each said in one of several ways, as is which "
        "rates a range holds. Two of them contradict each other, and none says nothing.",
        "ready:\n  model: {file: model.plan, topic: detector/status}\n",
        "ready:\n  model: {file: model.plan}\n",
    ),
    _page(
        "key-without-effect",
        "R2B119",
        "a key that has no use here",
        "The key is known, but what stands beside it leaves nobody to read it: the wish would "
        "silently not be fulfilled.",
        "playback: {mode: looping, timeline: {speed: 50 %}}\n",
        "playback: {mode: timeline, timeline: {speed: 50 %}}\n",
    ),
    _page(
        "swapped-keys",
        "R2B150",
        "two keys have each other's content",
        "Each content is wrong where it stands and right under the other key, so the keys were "
        "exchanged.",
        "monitors: {duration: 10 s}\n"
        "benchmark: {tags: {topic: tags, format: geometry_msgs/msg/PoseArray}}\n",
        "benchmark: {duration: 10 s}\n"
        "monitors: {tags: {topic: tags, format: geometry_msgs/msg/PoseArray}}\n",
    ),
)
