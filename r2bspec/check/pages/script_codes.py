"""R2B701 to R2B734: scripts of ros2_benchmark and launch files, which `import` and `init` read."""

from __future__ import annotations

from r2bspec.check.pages._page import error_page
from r2bspec.diagnostics.code_pages import Page
from r2bspec.diagnostics.diagnostic import Severity


def _page(slug: str, code: str, title: str, severity: Severity, why: str) -> Page:
    return Page(slug, code, title, severity, why, failing="", passing="")


SCRIPT_PAGES = (
    error_page(
        "script-unreadable",
        "R2B701",
        "script cannot be read",
        "A script is a regular file in UTF-8 of at most 300 kB. Pipes, devices and folders are "
        "refused.",
    ),
    error_page(
        "script-syntax",
        "R2B702",
        "script is not valid Python",
        "The script is read as a syntax tree, and never executed. What Python cannot parse has "
        "none.",
    ),
    error_page(
        "script-too-complex",
        "R2B703",
        "script exceeds the limits of evaluation",
        "Loops over constants and functions of the script are evaluated, up to a number of steps, "
        "of calls inside each other, and of items.",
    ),
    error_page(
        "not-a-benchmark-script",
        "R2B704",
        "not a script of ros2_benchmark, or not a launch file",
        "A script has a class derived from ROS2BenchmarkTest, with a 'config', and a function that "
        "returns its launch actions. A launch file has generate_launch_description.",
    ),
    error_page(
        "script-module-missing",
        "R2B705",
        "module of a script was not found",
        "Nodes or monitors of the script are made by functions of a module that is neither next to "
        "the script nor in a folder above, so they are left out. 'r2bspec import --package-path "
        "FOLDER' names the folder with its package.",
    ),
    _page(
        "not-imported",
        "R2B710",
        "part of a script was not imported",
        Severity.WARNING,
        "What the script alone does not determine, such as the content of a file, and what the "
        "language has no key for, is a comment in the spec. Nothing is guessed.",
    ),
    _page(
        "imported-differently",
        "R2B711",
        "imported with another meaning",
        Severity.INFO,
        "The spec says it in another way than the script, which can change what is measured.",
    ),
    _page(
        "sides-exchanged",
        "R2B720",
        "left and right are exchanged",
        Severity.WARNING,
        "A node for one side of a stereo camera gets the messages of the other side. Both sides "
        "then process the same images, and the figures are not those of a stereo graph.",
    ),
    _page(
        "node-name-twice",
        "R2B721",
        "two nodes have one name",
        Severity.ERROR,
        "Parameters, services and private topics are addressed by the full name of a node. A "
        "container may refuse the second one; the tool logs that and measures the rest.",
    ),
    _page(
        "remapping-cannot-match",
        "R2B722",
        "remapping has no effect",
        Severity.WARNING,
        "A remapping applies to the full name of a topic. In a namespace, a relative topic never "
        "has the absolute name without it.",
    ),
    _page(
        "parameter-unknown",
        "R2B723",
        "node has no such parameter",
        Severity.WARNING,
        "A component ignores parameters that it does not declare, so the node runs with its "
        "default.",
    ),
    _page(
        "monitor-not-read",
        "R2B724",
        "monitors and their list do not agree",
        Severity.ERROR,
        "The controller reads the monitors of monitor_info_list by the names of their services, "
        "which follow from their indices.",
    ),
    _page(
        "report-prefix-twice",
        "R2B725",
        "two monitors report under one prefix",
        Severity.WARNING,
        "The figures of a monitor are an object of the report under its prefix; of two with one "
        "prefix, the later one remains.",
    ),
    _page(
        "formats-and-inputs",
        "R2B726",
        "formats and inputs of the player differ in number",
        Severity.WARNING,
        "The player makes one input for each of its data_formats, under the names inputN and "
        "buffer/inputN.",
    ),
    _page(
        "buffer-without-source",
        "R2B727",
        "nothing publishes what the player buffers",
        Severity.WARNING,
        "The player waits until its buffers are full. A buffer whose topic has no publisher ends "
        "the run with '0 messages recorded'.",
    ),
    _page(
        "monitor-on-input",
        "R2B728",
        "an input is monitored",
        Severity.ERROR,
        "The monitor then measures the transport from the player, and nothing of the graph.",
    ),
    _page(
        "one-message-buffered",
        "R2B729",
        "one message is played again and again",
        Severity.INFO,
        "A graph that gets one message only has its data in caches, and no spread that depends on "
        "the content.",
    ),
    _page(
        "latency-of-two-messages",
        "R2B730",
        "latency of the first and the last message only",
        Severity.INFO,
        "Without keys, the tool cannot match outputs to inputs, and reports the latency of the "
        "first and of the last message of a run.",
    ),
    _page(
        "search-accepts-overload",
        "R2B731",
        "search accepts rates that are not sustained",
        Severity.INFO,
        "The search compares rates with an absolute tolerance, which at low rates is a large part "
        "of the messages; queues hide the rest.",
    ),
    _page(
        "sleep-until-ready",
        "R2B733",
        "fixed time until the graph is ready",
        Severity.INFO,
        "A fixed time is too long on one machine and too short on another, where the first "
        "messages are then lost.",
    ),
    _page(
        "transforms-counted",
        "R2B734",
        "transforms count as frames",
        Severity.WARNING,
        "In a timeline every message of every input counts as a frame that was sent, also those of "
        "/tf, to which no output answers.",
    ),
)
