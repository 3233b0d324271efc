/* An empty Python module, so that setuptools builds and finds the library. `rcdn.native` calls the kernels by ctypes, without the lock. */
#define Py_LIMITED_API 0x030B0000
#include <Python.h>

static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "rcdn._native", "Compiled kernels; see rcdn.native.", -1, NULL, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__native(void) {
    return PyModule_Create(&module);
}
