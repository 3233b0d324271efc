/* The Python side of the kernels: what turns arrays into the addresses that `rcdn.native` passes to them by ctypes, without the lock. */
#define Py_LIMITED_API 0x030B0000
#include <Python.h>

/* What `__array_struct__` of an array points to (NumPy's array interface). */
typedef struct {
    int two, dimensions;
    char kind;
    int itemsize, flags;
    Py_ssize_t *shape, *strides;
    void *data;
    PyObject *description;
} Interface;
enum { CONTIGUOUS = 0x1, ALIGNED = 0x100, NATIVE = 0x200, WRITEABLE = 0x400 };

/* What arrays of a letter hold: what messages call it, its kind and size. */
typedef struct {
    char letter, kind;
    int itemsize;
    const char *name;
} Kind;
static const Kind kinds[] = {{'f', 'f', 4, "float32"}, {'d', 'f', 8, "float64"}, {'b', 'u', 1, "uint8"}, {'c', 'i', 1, "int8"}, {'i', 'i', 4, "int32"}, {'l', 'i', 8, "int64"}};

static const Kind *kind_of(char letter) {
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++)
        if (kinds[k].letter == letter)
            return kinds + k;
    return NULL;
}

static int is_of(const Interface *a, char letter) {
    const Kind *kind = kind_of(letter);
    if (letter == 'p')
        return a->dimensions == 2 && (is_of(a, 'b') || is_of(a, 'f'));
    return kind && a->kind == kind->kind && a->itemsize == kind->itemsize;
}

/* Append to `out`, from its item `*n` on, what ctypes needs for `value`: its address, and for a picture its height, width and whether it is float. */
static int unpacked(PyObject *value, char letter, PyObject *out, Py_ssize_t *n) {
    const char type = letter >= 'a' ? letter : (char)(letter + ('a' - 'A'));
    const int needed = CONTIGUOUS | ALIGNED | NATIVE | (type == letter ? 0 : WRITEABLE);
    PyObject *capsule = PyObject_GetAttrString(value, "__array_struct__");
    const Interface *a = capsule ? PyCapsule_GetPointer(capsule, NULL) : NULL;
    if (!a || (a->flags & needed) != needed || !is_of(a, type)) {
        PyErr_Clear();
        PyErr_Format(PyExc_TypeError, "a kernel's array must be contiguous %s%s",
                     type == 'p' ? "uint8 or float32 of (H, W)" : kind_of(type) ? kind_of(type)->name : "no known kind",
                     type == letter ? "" : " that may be written to");
        Py_XDECREF(capsule);
        return 0;
    }
    PyTuple_SetItem(out, (*n)++, PyLong_FromVoidPtr(a->data));
    if (type == 'p') {
        PyTuple_SetItem(out, (*n)++, PyLong_FromSsize_t(a->shape[0]));
        PyTuple_SetItem(out, (*n)++, PyLong_FromSsize_t(a->shape[1]));
        PyTuple_SetItem(out, (*n)++, PyLong_FromLong(a->kind == 'f'));
    }
    Py_DECREF(capsule);
    return 1;
}

/* `arguments(letters, values)`: the values as ctypes takes them; arrays as their addresses. */
static PyObject *arguments(PyObject *self, PyObject *given) {
    PyObject *letters, *values;
    (void)self;
    if (!PyArg_ParseTuple(given, "SO!", &letters, &PyTuple_Type, &values))
        return NULL;
    const char *letter = PyBytes_AsString(letters);
    const Py_ssize_t count = PyTuple_Size(values);
    if (PyBytes_Size(letters) != count) {
        PyErr_Format(PyExc_TypeError, "a kernel needs %zd arguments, not %zd", PyBytes_Size(letters), count);
        return NULL;
    }
    Py_ssize_t size = count, n = 0;
    for (Py_ssize_t k = 0; k < count; k++)
        size += letter[k] == 'p' ? 3 : 0;
    PyObject *out = PyTuple_New(size);
    for (Py_ssize_t k = 0; out && k < count; k++) {
        PyObject *value = PyTuple_GetItem(values, k);
        if (letter[k] == 'n' || letter[k] == 'r') {
            Py_INCREF(value);
            PyTuple_SetItem(out, n++, value);
        } else if (!unpacked(value, letter[k], out, &n))
            Py_CLEAR(out);
    }
    if (out && PyErr_Occurred())
        Py_CLEAR(out);
    return out;
}

static PyMethodDef methods[] = {{"arguments", arguments, METH_VARARGS, "Values as ctypes takes them."}, {NULL, NULL, 0, NULL}};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "rcdn._native", "Compiled kernels; see rcdn.native.", -1, methods, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__native(void) {
    return PyModule_Create(&module);
}
