"""The JSON Schema of the language: one module for each section."""

from r2bspec.language.schema.derive_strict import (
    published_schema,
    published_schema_text,
    strict_schema,
)

__all__ = ["published_schema", "published_schema_text", "strict_schema"]
