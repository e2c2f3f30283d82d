"""Constraints between keys that the schema does not express."""
