/* Symbols of CPython for programs that load the wheels of ROS without an interpreter.
 *
 * Libraries in the wheels are linked to the converters of messages between C and Python, which are
 * never called here. The loader wants their data to exist at once, and their functions where
 * LD_BIND_NOW is set.
 */
#include <stdlib.h>

void *PyExc_RuntimeError;
long _Py_TrueStruct[8];

#define UNUSED(name) \
  void name(void); \
  __attribute__((noreturn)) void name(void) { abort(); }

UNUSED(PyBool_FromLong) UNUSED(PyBuffer_Release) UNUSED(PyBuffer_ToContiguous)
UNUSED(PyBytes_AsStringAndSize) UNUSED(PyBytes_FromStringAndSize) UNUSED(PyErr_SetString)
UNUSED(PyFloat_FromDouble) UNUSED(PyImport_ImportModule) UNUSED(PyList_New) UNUSED(PyList_SetItem)
UNUSED(PyLong_AsLong) UNUSED(PyLong_AsLongLong) UNUSED(PyLong_AsSize_t)
UNUSED(PyLong_AsUnsignedLong) UNUSED(PyLong_AsUnsignedLongLong) UNUSED(PyLong_FromLong)
UNUSED(PyLong_FromLongLong) UNUSED(PyLong_FromUnsignedLong) UNUSED(PyLong_FromUnsignedLongLong)
UNUSED(PyObject_CallFunctionObjArgs) UNUSED(PyObject_CallObject) UNUSED(PyObject_CheckBuffer)
UNUSED(PyObject_GetAttrString) UNUSED(PyObject_GetBuffer) UNUSED(PyObject_SetAttrString)
UNUSED(PyObject_Size) UNUSED(PySequence_Fast) UNUSED(PySequence_Size)
UNUSED(PyUnicode_AsUTF16String) UNUSED(PyUnicode_AsUTF8String) UNUSED(PyUnicode_DecodeUTF16)
UNUSED(PyUnicode_DecodeUTF8) UNUSED(_Py_Dealloc)
