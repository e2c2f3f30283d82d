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
        f"{description}: the name of a dataset, or the path of a bag relative to this file. As a "
        "map it can also pin the content.",
        {
            "dataset": text(
                "The name of a dataset; r2bspec data list shows those that can be made.",
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
                "The digest that the data must have, as r2bspec data info shows it. Another bag "
                "of the same name is then refused.",
                form=name_patterns.SHA256,
                examples=["a3f5" * 16],
            ),
        },
        examples=["r2b_storage", {"path": "./bags/kitchen"}],
        snippets=[
            {"label": "dataset", "body": "${1:r2b_storage}"},
            {"label": "bag with a pinned content", "body": {"path": "$1", "sha256": "$2"}},
        ],
    )


_WINDOW = record(
    "The part of the recording that is used, counted from its first message.",
    {
        "start": quantity(
            Duration, "Where the part begins.", default="0 s", examples=["0.0 s", "1.5 s"]
        ),
        "end": quantity(
            Duration,
            "Where the part ends; without it, the recording is used to its end.",
            examples=["0.5 s"],
            positive=True,
        ),
    },
    examples=[{"start": "0.0 s", "end": "0.5 s"}],
    default={},
)

DATA_LOADER: Schema = record(
    "Which recorded topics are loaded, and what they are called in the graph.",
    {
        "bag": _bag("The recording"),
        "bags": array(
            "Several recordings in place of one, in the order in which they were made; their "
            "topics are joined.",
            _bag("A recording"),
            examples=[["./bags/part_1", "./bags/part_2"]],
        ),
        "window": _WINDOW,
        "topics": name_map(
            "What is loaded: topic of the bag, and the topic that it becomes in the graph. Topics "
            "of the bag that are not named here are never touched.",
            name_patterns.TOPIC,
            text(
                "The topic in the graph; a relative one lies in the namespace of the benchmark.",
                form=name_patterns.TOPIC,
                examples=["data_loader/image"],
            ),
            topics=True,
            at_least=1,
            examples=[{"/d455_1_rgb_image": "data_loader/image"}],
        ),
        "publish_tf": boolean("Whether recorded /tf is played with the inputs.", default=False),
        "publish_tf_static": boolean(
            "Whether recorded /tf_static is published before anything is played.", default=False
        ),
        "real_time": boolean(
            "Whether the preprocessors get the messages in the time in which they were recorded, "
            "instead of as fast as they take them.",
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
