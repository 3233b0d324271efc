/* The Python interface of the kernels: checks a call against the kernel's declaration (kernel.h) and runs it without
 * the GIL. */
#define Py_LIMITED_API 0x030B0000
#include <Python.h>

#include "kernel.h"

static Kernel *kernels;
static Constants *all_constants;

void register_kernel(Kernel *kernel) {
    kernel->next = kernels;
    kernels = kernel;
}

void register_constants(Constants *constants) {
    constants->next = all_constants;
    all_constants = constants;
}

/* The struct that `__array_struct__` of an array points to (NumPy's array interface). */
typedef struct {
    int two, dimensions;
    char kind;
    int itemsize, flags;
    Py_ssize_t *shape, *strides;
    void *data;
    PyObject *description;
} Interface;
enum { CONTIGUOUS = 0x1, ALIGNED = 0x100, NATIVE = 0x200, WRITEABLE = 0x400 };

_Static_assert(sizeof(Py_ssize_t) == sizeof(index_t), "shapes are read as they are");

/* One call: its values, those in groups after those of the kernel, and the capsules that own the memory they point to.
 * */
typedef struct {
    const char *name;
    int used, kept;
    Value values[MOST_VALUES];
    PyObject *capsules[MOST_VALUES];
} Call;

static PyObject *array_struct; /* the attribute's name */

/* ---- conversion of the arguments */

static const char *type_name(const Spec *spec) {
    if (spec->what == PICTURE_GIVEN)
        return "uint8 or float32";
    const char *names[] = {"float64", "float32", "int64", "int32", "int8", "uint8"};
    const char kinds[] = "ffiiiu";
    const int sizes[] = {8, 4, 8, 4, 1, 1};
    for (int k = 0; k < 6; k++)
        if (kinds[k] == spec->kind && sizes[k] == spec->itemsize)
            return names[k];
    return "?";
}

static int refuse_type(const Call *call, const Spec *spec) {
    PyErr_Clear();
    PyErr_Format(PyExc_TypeError, "%s: %s must be a contiguous %s array%s", call->name, spec->name, type_name(spec),
                 spec->written ? " that may be written to" : "");
    return 0;
}

static int is_of(const Interface *a, char kind, int itemsize) {
    return a->kind == kind && a->itemsize == itemsize;
}

static int take_array(Call *call, const Spec *spec, PyObject *given, Value *value) {
    PyObject *capsule = PyObject_GetAttr(given, array_struct);
    if (!capsule)
        return refuse_type(call, spec);
    call->capsules[call->kept++] = capsule;
    const Interface *a = PyCapsule_GetPointer(capsule, NULL);
    const int needed = CONTIGUOUS | ALIGNED | NATIVE | (spec->written ? WRITEABLE : 0);
    if (!a || a->two != 2 || (a->flags & needed) != needed)
        return refuse_type(call, spec);
    if (spec->what == PICTURE_GIVEN ? !is_of(a, 'u', 1) && !is_of(a, 'f', 4) : !is_of(a, spec->kind, spec->itemsize))
        return refuse_type(call, spec);
    if (a->dimensions != spec->axes) {
        PyErr_Format(PyExc_ValueError, "%s: %s must have %d dimensions, not %d", call->name, spec->name, spec->axes,
                     a->dimensions);
        return 0;
    }
    value->data = a->data;
    value->shape = a->shape;
    value->size = 1;
    for (int k = 0; k < a->dimensions; k++) {
        if (a->shape[k] > FURTHEST) {
            PyErr_Format(PyExc_ValueError, "%s: %s is too long: %zd", call->name, spec->name, a->shape[k]);
            return 0;
        }
        value->size = (index_t)((size_t)value->size * (size_t)a->shape[k]); /* overflows in empty arrays only, to 0 */
    }
    if (spec->what == PICTURE_GIVEN) {
        value->picture = (Picture){a->data, a->shape[0], a->shape[1], a->kind == 'f'};
        if (!value->size) {
            PyErr_Format(PyExc_ValueError, "%s: %s has no pixels: %zd x %zd", call->name, spec->name, a->shape[0],
                         a->shape[1]);
            return 0;
        }
    }
    return 1;
}

static const Value *take_all(Call *call, const Spec *specs, int count, PyObject *const *given);

static int take_group(Call *call, const Spec *spec, PyObject *given, Value *value) {
    PyObject *items[MOST_VALUES];
    const int count = spec->group->count;
    if (!PyTuple_Check(given)) {
        PyErr_Format(PyExc_TypeError, "%s: %s must be a tuple", call->name, spec->name);
        return 0;
    }
    if (PyTuple_Size(given) != count) {
        PyErr_Format(PyExc_TypeError, "%s: %s must be a tuple of %d, not %zd", call->name, spec->name, count,
                     PyTuple_Size(given));
        return 0;
    }
    for (int k = 0; k < count; k++)
        items[k] = PyTuple_GetItem(given, k);
    value->group = take_all(call, spec->group->specs, count, items);
    return value->group != NULL;
}

static int named(const Call *call, const Spec *spec) {
    if (!PyErr_ExceptionMatches(PyExc_TypeError) && !PyErr_ExceptionMatches(PyExc_OverflowError))
        return 0;
    PyObject *type = PyErr_ExceptionMatches(PyExc_TypeError) ? PyExc_TypeError : PyExc_ValueError;
    PyErr_Clear();
    PyErr_Format(type, "%s: %s must be %s", call->name, spec->name,
                 spec->what == INT_GIVEN ? "a whole number that a machine knows" : "a number");
    return 0;
}

static int take(Call *call, const Spec *spec, PyObject *given, Value *value) {
    *value = (Value){.spec = spec};
    switch (spec->what) {
    case INT_GIVEN:
        value->whole = PyNumber_AsSsize_t(given, PyExc_OverflowError);
        return !(value->whole == -1 && PyErr_Occurred()) || named(call, spec);
    case REAL_GIVEN:
        value->real = PyFloat_AsDouble(given);
        return !(value->real == -1 && PyErr_Occurred()) || named(call, spec);
    case GROUP_GIVEN:
        return take_group(call, spec, given, value);
    default:
        return take_array(call, spec, given, value);
    }
}

static const Value *take_all(Call *call, const Spec *specs, int count, PyObject *const *given) {
    Value *values = call->values + call->used;
    call->used += count;
    for (int k = 0; k < count; k++)
        if (!take(call, specs + k, given[k], values + k))
            return NULL;
    return values;
}

/* ---- refusals */

static int apart(const Call *call) {
    for (int i = 0; i < call->used; i++) {
        const Value *a = call->values + i;
        if (!a->spec->written || !a->size)
            continue;
        const char *from = a->data, *to = from + a->size * a->spec->itemsize;
        for (int j = 0; j < call->used; j++) {
            const Value *b = call->values + j;
            if (i == j || !b->size)
                continue;
            const char *begin = b->data,
                       *end = begin + b->size * (b->spec->what == PICTURE_GIVEN ? (b->picture.real ? 4 : 1)
                                                                                : b->spec->itemsize);
            if (begin < to && from < end) {
                PyErr_Format(PyExc_ValueError, "%s: %s and %s share memory", call->name, a->spec->name, b->spec->name);
                return 0;
            }
        }
    }
    return 1;
}

static PyObject *tuple_of(const index_t *numbers, int count) {
    PyObject *out = PyTuple_New(count);
    for (int k = 0; out && k < count; k++)
        PyTuple_SetItem(out, k, PyLong_FromSsize_t(numbers[k]));
    return out;
}

static void raise_shape(const Call *call, const Refusal *refusal) {
    const Spec *spec = refusal->value->spec;
    PyObject *wanted = tuple_of(refusal->numbers, spec->axes), *given = tuple_of(refusal->value->shape, spec->axes);
    if (wanted && given)
        PyErr_Format(PyExc_ValueError, "%s: %s must be of shape (%s) = %R, not %R", call->name, spec->name,
                     refusal->wanted, wanted, given);
    Py_XDECREF(wanted);
    Py_XDECREF(given);
}

static void raise_refusal(const Call *call, const Refusal *r) {
    const char *name = r->value ? r->value->spec->name : "";
    if (r->why == SHAPE_REFUSED)
        raise_shape(call, r);
    else if (r->why == SIZE_REFUSED)
        PyErr_Format(PyExc_ValueError, "%s: %s must hold at least %s = %zd, not %zd", call->name, name, r->wanted,
                     r->numbers[0], r->given);
    else if (r->why == RANGE_REFUSED)
        PyErr_Format(PyExc_ValueError, "%s: %s must be within %zd..%zd, not %zd", call->name, name, r->numbers[0],
                     r->numbers[1], r->given);
    else
        PyErr_Format(PyExc_ValueError, "%s: it must hold that %s", call->name, r->wanted);
}

/* ---- the call */

static PyObject *checked_call(const Kernel *kernel, Call *call, PyObject *const *given) {
    const Value *values = take_all(call, kernel->specs, kernel->count, given);
    if (!values || !apart(call))
        return NULL;
    Refusal refusal;
    PyThreadState *state = PyEval_SaveThread();
    const index_t result = kernel->checked(values, &refusal);
    PyEval_RestoreThread(state);
    if (result >= 0)
        return PyLong_FromSsize_t(result);
    if (result == REFUSED)
        raise_refusal(call, &refusal);
    else
        PyErr_Format(PyExc_MemoryError, "%s: no memory for its workspace", kernel->name);
    return NULL;
}

static PyObject *called(PyObject *self, PyObject *const *given, Py_ssize_t count) {
    const Kernel *kernel = PyCapsule_GetPointer(self, NULL);
    Call call;
    if (!kernel)
        return NULL;
    if (count != kernel->count) {
        PyErr_Format(PyExc_TypeError, "%s needs %d arguments, not %zd", kernel->name, kernel->count, count);
        return NULL;
    }
    call.name = kernel->name;
    call.used = call.kept = 0;
    PyObject *out = checked_call(kernel, &call, given);
    for (int k = 0; k < call.kept; k++)
        Py_DECREF(call.capsules[k]);
    return out;
}

/* ---- contents of the module */

/* Number of values of an argument list, including those in groups. */
static int width_of(const Spec *specs, int count) {
    int width = count;
    for (int k = 0; k < count; k++)
        if (specs[k].group)
            width += width_of(specs[k].group->specs, specs[k].group->count);
    return width;
}

/* Put `value`, whose reference is stolen, into a dictionary; returns whether there is an error. */
static int put(PyObject *dictionary, const char *name, PyObject *value) {
    const int failed = !value || PyDict_SetItemString(dictionary, name, value) < 0;
    Py_XDECREF(value);
    return failed;
}

static PyObject *function_of(const Kernel *kernel) {
    PyObject *self = PyCapsule_New((void *)kernel, NULL, NULL);
    PyMethodDef *method = PyMem_Malloc(sizeof *method); /* as long as the process */
    if (!self || !method || width_of(kernel->specs, kernel->count) > MOST_VALUES) {
        Py_XDECREF(self);
        PyMem_Free(method);
        return PyErr_Occurred() ? NULL : PyErr_Format(PyExc_SystemError, "%s: too many arguments", kernel->name);
    }
    *method = (PyMethodDef){kernel->name, (PyCFunction)(void (*)(void))called, METH_FASTCALL, kernel->signature};
    PyObject *out = PyCFunction_New(method, self);
    Py_DECREF(self);
    return out;
}

static PyObject *specs_of(const Spec *specs, int count) {
    const char *what[] = {"picture", "array", "int", "real", "group"};
    PyObject *out = PyTuple_New(count);
    for (int k = 0; out && k < count; k++) {
        const Spec *s = specs + k;
        const char *type = s->what == ARRAY_GIVEN ? type_name(s) : "";
        PyObject *group = s->group ? specs_of(s->group->specs, s->group->count) : PyTuple_New(0);
        PyObject *spec =
            group ? Py_BuildValue("(sssiiN)", s->name, what[s->what], type, s->axes, s->written, group) : NULL;
        if (!spec) {
            Py_CLEAR(out);
            break;
        }
        PyTuple_SetItem(out, k, spec);
    }
    return out;
}

static PyObject *integers_of(const Constants *constants) {
    PyObject *out = PyDict_New();
    const char *name = constants->names;
    for (int k = 0; out && k < constants->count; k++) {
        const size_t length = strcspn(name, ", ");
        PyObject *key = PyUnicode_FromStringAndSize(name, (Py_ssize_t)length),
                 *value = PyLong_FromSsize_t(constants->values[k]);
        if (!key || !value || PyDict_SetItem(out, key, value) < 0)
            Py_CLEAR(out);
        Py_XDECREF(key);
        Py_XDECREF(value);
        name += length + strspn(name + length, ", ");
    }
    return out;
}

static PyObject *strings_of(const char *const *texts) {
    PyObject *out = PyList_New(0);
    for (; out && *texts; texts++) {
        PyObject *text = PyUnicode_FromString(*texts);
        if (!text || PyList_Append(out, text) < 0)
            Py_CLEAR(out);
        Py_XDECREF(text);
    }
    return out;
}

static PyMethodDef methods[] = {{NULL, NULL, 0, NULL}};
static struct PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "rcdn._native", "Compiled kernels; see rcdn.native.", -1, methods, NULL, NULL, NULL, NULL};

/* `level`: the instruction set that kernels use, one of `levels`. `kernels`: functions by name. `arguments`: for each, in order, (name,
 * what, type, axes, whether it is written to, (those of a group)). `constants`: by unit and name. */
PyMODINIT_FUNC PyInit__native(void) {
    PyObject *out = PyModule_Create(&module), *functions = PyDict_New(), *arguments = PyDict_New(),
             *constants = PyDict_New(), *levels = strings_of(level_names);
    array_struct = PyUnicode_InternFromString("__array_struct__");
    const char *level = find_level();
    if (!level && levels)
        PyErr_Format(PyExc_ValueError, "RCDN_LEVEL must be one of %R", levels);
    int failed = !level || !out || !functions || !arguments || !constants || !levels || !array_struct;
    for (const Kernel *k = kernels; k && !failed; k = k->next)
        failed = put(functions, k->name, function_of(k)) || put(arguments, k->name, specs_of(k->specs, k->count));
    for (const Constants *c = all_constants; c && !failed; c = c->next)
        failed = put(constants, c->unit, integers_of(c));
    failed = failed || PyModule_AddStringConstant(out, "level", level) < 0 ||
             PyModule_AddObjectRef(out, "levels", levels) < 0 || PyModule_AddObjectRef(out, "kernels", functions) < 0 ||
             PyModule_AddObjectRef(out, "arguments", arguments) < 0 ||
             PyModule_AddObjectRef(out, "constants", constants) < 0;
    Py_XDECREF(functions);
    Py_XDECREF(arguments);
    Py_XDECREF(constants);
    Py_XDECREF(levels);
    if (failed)
        Py_CLEAR(out);
    return out;
}
