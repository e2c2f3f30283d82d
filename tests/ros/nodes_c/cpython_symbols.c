// In the wheels of ROS, librcl needs libraries that were built for an interpreter. A C program has
// to bring the variables of CPython that they refer to; it never calls the functions that use them.

void * PyExc_RuntimeError;
void * _Py_TrueStruct[4];
