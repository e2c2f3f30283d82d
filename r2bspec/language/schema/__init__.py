"""The JSON Schema of the language, from one source: a module for each section."""
