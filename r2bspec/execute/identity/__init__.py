"""What a graph is made of, looked up without executing anything of it."""

from __future__ import annotations

from r2bspec.execute.identity.identify_graph import graph_identity

__all__ = ["graph_identity"]
