"""R2B0xx: the file and its YAML."""

from __future__ import annotations

from r2bspec.diagnostics.code_pages import Page
from r2bspec.diagnostics.diagnostic import Severity

_ERROR = Severity.ERROR

YAML_PAGES = (
    Page(
        "R2B001",
        "the file cannot be read",
        _ERROR,
        "Without the file nothing can be said about it. Examples are missing: it is the file "
        "system that refuses.",
        "",
        "",
    ),
    Page(
        "R2B002",
        "the document is too large",
        _ERROR,
        "A spec names its data and has a few thousand bytes. The limit keeps a wrong path, say to "
        "a bag, from filling the memory.",
        "",
        "",
    ),
    Page(
        "R2B003",
        "the file is not UTF-8 text",
        _ERROR,
        "YAML is text. Characters that are none are the sign of a binary file, or of another "
        "encoding.",
        "title: a\x07b\n",
        "title: ab\n",
    ),
    Page(
        "R2B004",
        "the file begins with a byte-order mark",
        Severity.WARNING,
        "The mark is invisible, and some tools take it for a part of the first key.",
        "\ufefftitle: x\n",
        "title: x\n",
    ),
    Page(
        "R2B005",
        "further problems are not shown",
        Severity.INFO,
        "A thousand findings are a sign of one mistake that was made a thousand times; put it "
        "right, and ask again.",
        "",
        "",
    ),
    Page(
        "R2B010",
        "this is not YAML",
        _ERROR,
        "The text cannot be read from here on. Quoting the value helps most often.",
        "title: |text\n  more\n",
        "title: |\n  text\n  more\n",
    ),
    Page(
        "R2B011",
        "a tab where indentation is counted",
        _ERROR,
        "Editors show tabs in different widths, so YAML counts blanks only.",
        "benchmark:\n\tduration: 10 s\n",
        "benchmark:\n  duration: 10 s\n",
    ),
    Page(
        "R2B012",
        "a quote or a bracket has no partner",
        _ERROR,
        "Everything after it is read as a part of the same value.",
        "benchmark:\n  rates: [10 Hz, 30 Hz\n",
        "benchmark:\n  rates: [10 Hz, 30 Hz]\n",
    ),
    Page(
        "R2B013",
        "unquoted text begins with a reserved character",
        _ERROR,
        "@, `, %, * and & have a meaning of their own at the beginning of a value.",
        "title: @home\n",
        'title: "@home"\n',
    ),
    Page(
        "R2B014",
        "a colon or a dash where YAML expects none",
        _ERROR,
        "': ' makes a key of what is before it, and a key needs a line or braces of its own.",
        "title: Detection: 720p\n",
        'title: "Detection: 720p"\n',
    ),
    Page(
        "R2B015",
        "the indentation does not line up",
        _ERROR,
        "Indentation says what belongs together; a line between two levels belongs to neither.",
        "benchmark:\n    duration: 10 s\n  iterations: 3\n",
        "benchmark:\n  duration: 10 s\n  iterations: 3\n",
    ),
    Page(
        "R2B016",
        "an unknown escape in double quotes",
        _ERROR,
        "In double quotes a backslash begins an escape. In single quotes it is itself.",
        'title: "100\\% real"\n',
        "title: '100\\% real'\n",
    ),
    Page(
        "R2B020",
        "the file holds no document",
        _ERROR,
        "A file without content, or with comments only, describes no benchmark.",
        "# nothing yet\n",
        "r2bspec: 1\nname: example\n",
    ),
    Page(
        "R2B021",
        "more than one document",
        _ERROR,
        "One file is one benchmark, so that a name and a path mean the same.",
        "r2bspec: 1\n---\nr2bspec: 1\n",
        "r2bspec: 1\n",
    ),
    Page(
        "R2B022",
        "a tag",
        _ERROR,
        "Tags ask the reader to construct objects; in a file from a stranger that is code. Every "
        "value here has the type that its text shows.",
        "title: !!python/name:os.system x\n",
        "title: x\n",
    ),
    Page(
        "R2B023",
        "a key stands twice",
        _ERROR,
        "Most readers silently keep the last one, and half of what was written is gone.",
        "benchmark:\n  duration: 10 s\n  duration: 20 s\n",
        "benchmark:\n  duration: 20 s\n",
    ),
    Page(
        "R2B024",
        "a key that is not text",
        _ERROR,
        "Numbers, truth values and lists cannot name anything in the language.",
        "labels:\n  1: first\n",
        'labels:\n  "a1": first\n',
    ),
    Page(
        "R2B025",
        "nested too deeply",
        _ERROR,
        "No spec needs a hundred levels; a bracket that was never closed makes them easily.",
        "title: " + "[" * 101 + "\n",
        "title: shallow\n",
    ),
    Page(
        "R2B026",
        "an alias without a value",
        _ERROR,
        "'*name' stands for the value that '&name' marked before it.",
        "benchmark: *defaults\n",
        "x-defaults: &defaults {duration: 10 s}\nbenchmark: *defaults\n",
    ),
    Page(
        "R2B027",
        "the aliases expand to too much",
        _ERROR,
        "Aliases of aliases grow by multiplication: nine lines of them can fill any memory.",
        "".join(
            f"x-{level}: &a{level} [{', '.join(['1' if not level else f'*a{level - 1}'] * 10)}]\n"
            for level in range(7)
        ),
        "x-rates: &rates [10 Hz, 30 Hz]\nbenchmark: {rates: *rates}\n",
    ),
    Page(
        "R2B028",
        "a merge of something that is no map",
        _ERROR,
        "'<<' takes up the keys of another map; a scalar or a list has none.",
        "benchmark: {<<: 10 s}\n",
        "x-common: &common {duration: 10 s}\nbenchmark: {<<: *common, iterations: 3}\n",
    ),
    Page(
        "R2B029",
        "a number that no spec can hold",
        _ERROR,
        "Whole numbers have 64 bits, as in ROS parameters. Infinity and 'not a number' have no "
        "place in JSON, in which plans and results are written.",
        "labels: {serial: 99999999999999999999}\n",
        'labels: {serial: "99999999999999999999"}\n',
    ),
)
