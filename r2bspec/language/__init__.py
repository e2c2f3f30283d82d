"""The language of specs: from YAML text with positions to a frozen, typed `Spec`."""
