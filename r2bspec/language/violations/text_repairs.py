"""Corrections of text that is not in the required form."""

from __future__ import annotations

import re
from typing import Any

from r2bspec.language.schema.name_patterns import MESSAGE_TYPE, PYTHON_NODE, TOPIC
from r2bspec.language.schema.schema_builder import NOUN


def repair_text(text: str, schema: dict[str, Any]) -> str:
    """A valid text that certainly has the same meaning, or an empty string."""
    noun = schema[NOUN]
    if noun == MESSAGE_TYPE.noun:
        guess = _message_type(text)
    elif noun == PYTHON_NODE.noun:
        guess = text.replace(":", ".") if ".py" not in text and "/" not in text else ""
    elif noun == TOPIC.noun:
        guess = _topic(text)
    else:
        guess = text.strip()
    return guess if guess != text and re.search(schema["pattern"], guess) else ""


def repair_name(name: str, schema: dict[str, Any]) -> str:
    """A valid name close to an invalid one, or an empty string."""
    guess = repair_text(name, schema) or re.sub(r"[^A-Za-z0-9_/~]+", "_", name).strip("_")
    return guess if guess != name and re.search(schema["pattern"], guess) else ""


def _message_type(text: str) -> str:
    parts = re.split(r"[./]|::", text.strip())
    if len(parts) == 2:
        parts.insert(1, "msg")
    return "/".join(parts)


def _topic(text: str) -> str:
    return re.sub(r"/{2,}", "/", text.strip()).rstrip("/")
