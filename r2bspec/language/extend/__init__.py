"""`extends`: documents that extend files, and entries that extend siblings."""

from r2bspec.language.extend.extended_files import ExtendResult, extend
from r2bspec.language.extend.extended_siblings import extend_siblings

__all__ = ["ExtendResult", "extend", "extend_siblings"]
