"""The language: YAML text with positions in, a frozen and typed `Spec` out."""
