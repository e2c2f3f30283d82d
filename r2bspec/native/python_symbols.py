"""Symbols of CPython for programs that load the wheels of ROS without an interpreter.

Libraries in the wheels are linked to the converters of messages between C and Python, which are
never called by such a program. The loader wants their data to exist at once, and their functions
where ``LD_BIND_NOW`` is set.
"""

from __future__ import annotations

_SYMBOLS = """
PyExc_RuntimeError _Py_TrueStruct PyBool_FromLong PyBuffer_Release PyBuffer_ToContiguous
PyBytes_AsStringAndSize PyBytes_FromStringAndSize PyErr_SetString PyFloat_FromDouble
PyImport_ImportModule PyList_New PyList_SetItem PyLong_AsLong PyLong_AsLongLong
PyLong_AsSize_t PyLong_AsUnsignedLong PyLong_AsUnsignedLongLong PyLong_FromLong
PyLong_FromLongLong PyLong_FromUnsignedLong PyLong_FromUnsignedLongLong
PyObject_CallFunctionObjArgs PyObject_CallObject PyObject_CheckBuffer PyObject_GetAttrString
PyObject_GetBuffer PyObject_SetAttrString PyObject_Size PySequence_Fast PySequence_Size
PyUnicode_AsUTF16String PyUnicode_AsUTF8String PyUnicode_DecodeUTF16 PyUnicode_DecodeUTF8
_Py_Dealloc
"""


def symbol_flags() -> list[str]:
    """Flags of the compiler that define the symbols, at an address that cannot be used."""
    return [f"-Wl,--defsym={each}=0" for each in _SYMBOLS.split()]
