"""R2B001 to R2B029: the file and its YAML."""

from __future__ import annotations

from r2bspec.diagnostics.code_pages import Page
from r2bspec.diagnostics.diagnostic import Severity

_ERROR = Severity.ERROR

YAML_PAGES = (
    Page(
        "file-unreadable",
        "R2B001",
        "the file cannot be read",
        _ERROR,
        "The file does not exist, is a folder, or cannot be read by this user.",
        "",
        "",
    ),
    Page(
        "document-too-large",
        "R2B002",
        "the document is too large",
        _ERROR,
        "A spec has a few thousand bytes and refers to its data by path. The limit keeps a wrong "
        "path, for example to a bag, from filling the memory. The number of waivers is limited, "
        "too.",
        "",
        "",
    ),
    Page(
        "not-utf-8-text",
        "R2B003",
        "the file is not UTF-8 text",
        _ERROR,
        "YAML files are UTF-8 text. Invalid bytes and control characters indicate a binary file or "
        "another encoding.",
        "title: a\x07b\n",
        "title: ab\n",
    ),
    Page(
        "byte-order-mark",
        "R2B004",
        "the file begins with a byte-order mark",
        Severity.WARNING,
        "The mark is invisible, and some tools read it as part of the first key.",
        "\ufefftitle: x\n",
        "title: x\n",
    ),
    Page(
        "too-many-findings",
        "R2B005",
        "further problems are not shown",
        Severity.INFO,
        "Thousands of problems usually have one cause. Fix it, and validate again. A rule stops "
        "after a thousand findings; where the rest may include an error, this is one, too.",
        "",
        "",
    ),
    Page(
        "invalid-yaml",
        "R2B010",
        "invalid YAML",
        _ERROR,
        "The parser cannot continue from here. Quoting the value often helps.",
        "title: |text\n  more\n",
        "title: |\n  text\n  more\n",
    ),
    Page(
        "tab-indentation",
        "R2B011",
        "a tab in the indentation",
        _ERROR,
        "YAML allows only spaces, because the width of a tab depends on the editor.",
        "benchmark:\n\tduration: 10 s\n",
        "benchmark:\n  duration: 10 s\n",
    ),
    Page(
        "unclosed-quote-or-bracket",
        "R2B012",
        "an unclosed quote or bracket",
        _ERROR,
        "Everything after it is read as part of the same value.",
        "benchmark:\n  rates: [10 Hz, 30 Hz\n",
        "benchmark:\n  rates: [10 Hz, 30 Hz]\n",
    ),
    Page(
        "reserved-character",
        "R2B013",
        "unquoted text begins with a reserved character",
        _ERROR,
        "@, `, %, * and & have a special meaning at the beginning of a value. Quote the value.",
        "title: @home\n",
        'title: "@home"\n',
    ),
    Page(
        "misplaced-colon-or-dash",
        "R2B014",
        "a misplaced colon or dash",
        _ERROR,
        "': ' makes a key of the text before it, and '- ' starts an item of a list. Quote a value "
        "that contains one of them.",
        "title: Detection: 720p\n",
        'title: "Detection: 720p"\n',
    ),
    Page(
        "wrong-indentation",
        "R2B015",
        "inconsistent indentation",
        _ERROR,
        "Indentation defines the structure. A line between two levels belongs to neither.",
        "benchmark:\n    duration: 10 s\n  iterations: 3\n",
        "benchmark:\n  duration: 10 s\n  iterations: 3\n",
    ),
    Page(
        "unknown-escape",
        "R2B016",
        "an unknown escape in double quotes",
        _ERROR,
        "In double quotes a backslash begins an escape sequence; in single quotes it is an "
        "ordinary character.",
        'title: "100\\% real"\n',
        "title: '100\\% real'\n",
    ),
    Page(
        "empty-document",
        "R2B020",
        "the file contains no document",
        _ERROR,
        "The file is empty, or has only comments.",
        "# nothing yet\n",
        "r2bspec: 1\nname: example\n",
    ),
    Page(
        "several-documents",
        "R2B021",
        "more than one YAML document in a file",
        _ERROR,
        "A file contains one benchmark, so that its path identifies it.",
        "r2bspec: 1\n---\nr2bspec: 1\n",
        "r2bspec: 1\n",
    ),
    Page(
        "yaml-tag",
        "R2B022",
        "a YAML tag",
        _ERROR,
        "Tags let a file construct objects, and so execute code, when it is read. In a spec the "
        "type of a value follows from its text.",
        "title: !!python/name:os.system x\n",
        "title: x\n",
    ),
    Page(
        "duplicate-key",
        "R2B023",
        "a duplicate key",
        _ERROR,
        "Most YAML parsers silently keep the last value and ignore the others.",
        "benchmark:\n  duration: 10 s\n  duration: 20 s\n",
        "benchmark:\n  duration: 20 s\n",
    ),
    Page(
        "key-not-a-string",
        "R2B024",
        "a key that is not a string",
        _ERROR,
        "All keys of the language are strings. Quote a key that looks like a number or a boolean.",
        "labels:\n  1: first\n",
        'labels:\n  "a1": first\n',
    ),
    Page(
        "nested-too-deeply",
        "R2B025",
        "values nested too deeply",
        _ERROR,
        "No spec needs a hundred levels. The cause is usually an unclosed bracket.",
        "title: " + "[" * 101 + "\n",
        "title: shallow\n",
    ),
    Page(
        "invalid-alias",
        "R2B026",
        "an invalid alias",
        _ERROR,
        "'*name' refers to the value with the anchor '&name', which must come before it and must "
        "not contain the alias.",
        "benchmark: *defaults\n",
        "x-defaults: &defaults {duration: 10 s}\nbenchmark: *defaults\n",
    ),
    Page(
        "alias-expansion-too-large",
        "R2B027",
        "aliases that expand to too many values",
        _ERROR,
        "The size of nested aliases multiplies: a few lines can fill the memory.",
        "".join(
            f"x-{level}: &a{level} [{', '.join(['1' if not level else f'*a{level - 1}'] * 10)}]\n"
            for level in range(7)
        ),
        "x-rates: &rates [10 Hz, 30 Hz]\nbenchmark: {rates: *rates}\n",
    ),
    Page(
        "invalid-merge-key",
        "R2B028",
        "an invalid merge key",
        _ERROR,
        "'<<' merges the keys of another map. It can be used once per map, and only with maps.",
        "benchmark: {<<: 10 s}\n",
        "x-common: &common {duration: 10 s}\nbenchmark: {<<: *common, iterations: 3}\n",
    ),
    Page(
        "unsupported-number",
        "R2B029",
        "an unsupported number",
        _ERROR,
        "Integers have 64 bits, as in ROS parameters. Infinity and NaN cannot be written to plans "
        "and results, which are JSON.",
        "labels: {serial: 99999999999999999999}\n",
        'labels: {serial: "99999999999999999999"}\n',
    ),
)
