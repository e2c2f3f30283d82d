"""Bringing up the processes of a run until every one is ready."""
