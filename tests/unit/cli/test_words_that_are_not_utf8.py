"""What is typed may be any bytes; Python has those that are not UTF-8 as lone surrogates."""

from __future__ import annotations
