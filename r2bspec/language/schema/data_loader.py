"""`data_loader`: the recorded messages."""

from __future__ import annotations

from r2bspec.language.bag_formats import SUFFIXES_TEXT
from r2bspec.language.quantities import Duration
from r2bspec.language.schema import name_patterns
from r2bspec.language.schema.schema_builder import (
    PATH,
    Schema,
    array,
    boolean,
    name_map,
    quantity,
    record,
    text,
)


def _bag(description: str) -> Schema:
    return {**_source(description), "type": ["string", "object"], "minLength": 1, PATH: True}


def _source(description: str) -> Schema:
    return record(
        f"{description}: the name of a dataset, or the path of a bag relative to this file. A map "
        "can also pin the content.",
        {
            "dataset": text(
                "The name of a dataset; 'r2bspec data list' lists them.",
                form=name_patterns.DATASET,
                examples=["r2b_storage", "r2b_lounge"],
            ),
            "path": text(
                f"The path of a bag: its folder, or a single {SUFFIXES_TEXT} file; "
                "relative to this file.",
                form=name_patterns.NOT_EMPTY,
                examples=["./bags/kitchen", "/data/drive_07.mcap"],
                path=True,
            ),
            "sha256": text(
                "The digest of the data, as 'r2bspec data info' shows it. A bag with other content "
                "is refused.",
                form=name_patterns.SHA256,
                examples=["a3f5" * 16],
            ),
        },
        examples=["r2b_storage", {"path": "./bags/kitchen"}],
        snippets=[
            {"label": "dataset", "body": "${1:r2b_storage}"},
            {"label": "bag with pinned content", "body": {"path": "$1", "sha256": "$2"}},
        ],
    )


_WINDOW = record(
    "The part of the recording to use, relative to its first message.",
    {
        "start": quantity(
            Duration, "The start of the window.", default="0 s", examples=["0.0 s", "1.5 s"]
        ),
        "end": quantity(
            Duration,
            "The end of the window; default: the end of the recording.",
            examples=["0.5 s"],
            positive=True,
        ),
    },
    examples=[{"start": "0.0 s", "end": "0.5 s"}],
    default={},
)

DATA_LOADER: Schema = record(
    "The recorded topics to load, and their names in the graph.",
    {
        "bag": _bag("The recording"),
        "bags": array(
            "Several recordings instead of one, in the order of recording; their topics are "
            "merged.",
            _bag("A recording"),
            examples=[["./bags/part_1", "./bags/part_2"]],
        ),
        "window": _WINDOW,
        "topics": name_map(
            "The topics to load: the topic in the bag, and the topic in the graph. Other topics of "
            "the bag are ignored.",
            name_patterns.TOPIC,
            text(
                "The topic in the graph; a relative name is in the namespace of the benchmark.",
                form=name_patterns.TOPIC,
                examples=["data_loader/image"],
            ),
            topics=True,
            at_least=1,
            examples=[{"/d455_1_rgb_image": "data_loader/image"}],
        ),
        "publish_tf": boolean("Whether the recorded /tf is played with the inputs.", default=False),
        "publish_tf_static": boolean(
            "Whether the recorded /tf_static is published before playing starts.", default=False
        ),
        "real_time": boolean(
            "Whether the preprocessors get the messages at the recorded times instead of as fast "
            "as they process them.",
            default=False,
        ),
    },
    unless_live=["topics"],
    examples=[{"bag": "r2b_storage", "topics": {"/d455_1_rgb_image": "data_loader/image"}}],
    snippets=[
        {
            "label": "data_loader",
            "body": {"bag": "${1:r2b_storage}", "topics": {"/${2:topic}": "data_loader/${3:name}"}},
        }
    ],
)
