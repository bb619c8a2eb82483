/* The extension module resample.engine.compiled._kernels: calls of compiled kernels.

   A call's arguments are walked once. The walk writes two things: a key, which names their types as
   resample.engine.compiled.compiling.key_of does, and numbers of eight bytes, which are what numba's calling
   convention takes them apart to. A kernel's entries are compared with the key; the code of the one
   that is equal gets the numbers, without Python's lock.

   Uses Python's stable interface, and NumPy's of 2.0. */
#define Py_LIMITED_API 0x030B0000
#define NPY_NO_DEPRECATED_API NPY_2_0_API_VERSION
#define NPY_TARGET_VERSION NPY_2_0_API_VERSION
#include <Python.h>
#include <numpy/arrayobject.h>
#include <numpy/arrayscalars.h>
#include <stdlib.h>
#include <string.h>

#ifdef __x86_64__
#include <cpuid.h>
#endif

#include "entries.h"

#define KEY 8192       /* bytes of a key that need no memory of their own */
#define NUMBERS 2048   /* likewise */
#define RESULTS 512    /* numbers that a kernel may give */
#define USER_ERROR 1   /* numba's status: from here on the first result points at what was raised */
#define PYTHON_ERROR -1 /* Python knows it already */

void release(void *memory);

static PyObject *type_names;  /* dict: class of tuples -> bytes */
static PyObject *dtype_names; /* dict: dtype of fields -> bytes */
static PyObject *dtypes;      /* dict: name -> dtype */
static PyObject *dtype_name;  /* function of Python's: dtype -> name */
static int is_wide;           /* whether the processor has x86-64-v4 */

/* ---- What a walk writes -------------------------------------------------------------------- */

typedef struct {
    char *key;
    size_t key_size, key_room;
    int64_t *number;
    size_t count, room;
    int is_unknown; /* an argument that no entry can have */
    char own_key[KEY];
    int64_t own_number[NUMBERS];
} Walk;

static void begin(Walk *walk) {
    walk->key = walk->own_key;
    walk->number = walk->own_number;
    walk->key_size = walk->count = 0;
    walk->key_room = KEY;
    walk->room = NUMBERS;
    walk->is_unknown = 0;
}

static void end(Walk *walk) {
    if (walk->key != walk->own_key) free(walk->key);
    if (walk->number != walk->own_number) free(walk->number);
}

/* A larger place for what `old` holds, which is freed unless it is `own`; NULL: out of memory. */
static void *grown(void *old, void *own, size_t size, size_t new_size) {
    void *larger = old == own ? malloc(new_size) : realloc(old, new_size);
    if (!larger) PyErr_NoMemory();
    if (larger && old == own) memcpy(larger, old, size);
    return larger;
}

static int put_text(Walk *walk, const char *text, size_t size) {
    if (walk->key_size + size > walk->key_room) {
        size_t room = 2 * (walk->key_size + size);
        char *larger = grown(walk->key, walk->own_key, walk->key_size, room);
        if (!larger) return -1;
        walk->key = larger;
        walk->key_room = room;
    }
    memcpy(walk->key + walk->key_size, text, size);
    walk->key_size += size;
    return 0;
}

static int64_t *put_numbers(Walk *walk, size_t count) {
    if (walk->count + count > walk->room) {
        size_t room = 2 * (walk->count + count), size = sizeof(int64_t);
        int64_t *larger = grown(walk->number, walk->own_number, walk->count * size, room * size);
        if (!larger) return NULL;
        walk->number = larger;
        walk->room = room;
    }
    int64_t *first = walk->number + walk->count;
    walk->count += count;
    return first;
}

static int put(Walk *walk, const char *text, int64_t number) {
    int64_t *at = put_numbers(walk, 1);
    if (!at) return -1;
    *at = number;
    return put_text(walk, text, strlen(text));
}

/* ---- Arguments ------------------------------------------------------------------------------ */

/* Name of a dtype of numbers, as `library.dtype_name` gives it; NULL: of something else. */
static const char *number_name(int type) {
    switch (type) {
        case NPY_BOOL: return "b1";
        case NPY_INT8: return "i1";
        case NPY_UINT8: return "u1";
        case NPY_INT16: return "i2";
        case NPY_UINT16: return "u2";
        case NPY_FLOAT32: return "f4";
        case NPY_FLOAT64: return "f8";
        case NPY_COMPLEX64: return "c8";
        case NPY_COMPLEX128: return "c16";
    }
    if (type == NPY_INT32) return "i4";
    if (type == NPY_UINT32) return "u4";
    if (type == NPY_LONG || type == NPY_LONGLONG) return "i8";
    if (type == NPY_ULONG || type == NPY_ULONGLONG) return "u8";
    return NULL;
}

/* Looks `key` up, or asks `make` for it and keeps that. Borrowed. */
static PyObject *kept(PyObject *dict, PyObject *key, PyObject *(*make)(PyObject *)) {
    PyObject *found = PyDict_GetItemWithError(dict, key);
    if (found || PyErr_Occurred()) return found;
    found = make(key);
    if (!found) return NULL;
    int failed = PyDict_SetItem(dict, key, found);
    Py_DECREF(found);
    return failed ? NULL : found;
}

/* Name of a dtype as bytes, by Python. */
static PyObject *named_dtype(PyObject *dtype) {
    PyObject *name = PyObject_CallFunctionObjArgs(dtype_name, dtype, NULL);
    PyObject *bytes = name ? PyUnicode_AsUTF8String(name) : NULL;
    Py_XDECREF(name);
    return bytes;
}

/* "module.Name" of a class of bundles; "" of tuple. */
static PyObject *named_class(PyObject *of) {
    if (of == (PyObject *)&PyTuple_Type) return PyBytes_FromString("");
    PyObject *module = PyObject_GetAttrString(of, "__module__");
    PyObject *name = module ? PyObject_GetAttrString(of, "__qualname__") : NULL;
    PyObject *text = name ? PyUnicode_FromFormat("%S.%S", module, name) : NULL;
    PyObject *bytes = text ? PyUnicode_AsUTF8String(text) : NULL;
    Py_XDECREF(module);
    Py_XDECREF(name);
    Py_XDECREF(text);
    return bytes;
}

/* A name that a dict keeps as bytes. */
static int put_kept(Walk *walk, PyObject *bytes) {
    char *text;
    Py_ssize_t size;
    if (!bytes || PyBytes_AsStringAndSize(bytes, &text, &size)) return -1;
    return put_text(walk, text, (size_t)size);
}

static int walk_array(Walk *walk, PyArrayObject *array) {
    PyArray_Descr *dtype = PyArray_DESCR(array);
    const int flags = PyArray_FLAGS(array), n = PyArray_NDIM(array);
    if (!PyDataType_ISNOTSWAPPED(dtype) || !(flags & NPY_ARRAY_ALIGNED)) {
        walk->is_unknown = 1; /* rare: numba says what it takes */
        return 0;
    }
    /* Key: [dtype,dimensions,layout] */
    if (put_text(walk, "[", 1)) return -1;
    if (dtype->type_num == NPY_VOID) {
        if (put_kept(walk, kept(dtype_names, (PyObject *)dtype, named_dtype))) return -1;
    } else {
        const char *name = number_name(dtype->type_num);
        if (!name) {
            walk->is_unknown = 1;
            return 0;
        }
        if (put_text(walk, name, strlen(name))) return -1;
    }
    char rest[8] = {',', (char)('0' + n / 10), (char)('0' + n % 10), ','};
    char *first = rest + 4;
    if (n < 10) {
        rest[1] = rest[2];
        rest[2] = ',';
        first = rest + 3;
    }
    *first++ = flags & NPY_ARRAY_C_CONTIGUOUS ? 'C' : flags & NPY_ARRAY_F_CONTIGUOUS ? 'F' : 'A';
    if (!(flags & NPY_ARRAY_WRITEABLE)) *first++ = 'r';
    *first++ = ']';
    if (put_text(walk, rest, (size_t)(first - rest))) return -1;
    /* Numbers: no count of references, no owner, then what the array is. */
    int64_t *number = put_numbers(walk, 5 + 2 * (size_t)n);
    if (!number) return -1;
    number[0] = number[1] = 0;
    number[2] = PyArray_SIZE(array);
    number[3] = PyArray_ITEMSIZE(array);
    number[4] = (int64_t)(intptr_t)PyArray_DATA(array);
    for (int axis = 0; axis < n; axis++) {
        number[5 + axis] = PyArray_DIM(array, axis);
        number[5 + n + axis] = PyArray_STRIDE(array, axis);
    }
    return 0;
}

static int walk_float(Walk *walk, double value) {
    int64_t number;
    memcpy(&number, &value, sizeof number);
    return put(walk, "d", number);
}

/* An int of Python's; numba takes for int64 what fits. */
static int walk_int(Walk *walk, PyObject *value) {
    int overflow;
    long long number = PyLong_AsLongLongAndOverflow(value, &overflow);
    if (number == -1 && PyErr_Occurred()) return -1;
    walk->is_unknown |= overflow != 0;
    return put(walk, "q", number);
}

/* A number of NumPy's. */
static int walk_scalar(Walk *walk, PyObject *value) {
    char data[32] = {0};
    PyArray_Descr *dtype = PyArray_DescrFromScalar(value);
    if (!dtype) return -1;
    const int type = dtype->type_num;
    Py_DECREF(dtype);
    const char *name = number_name(type);
    if (!name || name[0] == 'c') {
        walk->is_unknown = 1;
        return 0;
    }
    PyArray_ScalarAsCtype(value, data);
    int64_t number = 0;
    switch (type) {
        case NPY_BOOL: return put(walk, "b", data[0] != 0);
        case NPY_FLOAT64: memcpy(&number, data, 8); return put(walk, "d", number);
        case NPY_FLOAT32: memcpy(&number, data, 4); break; /* its bits, in the low half */
        case NPY_INT8: number = *(int8_t *)data; break;
        case NPY_INT16: { int16_t small; memcpy(&small, data, 2); number = small; break; }
        case NPY_UINT8: number = *(uint8_t *)data; break;
        case NPY_UINT16: { uint16_t small; memcpy(&small, data, 2); number = small; break; }
        default:
            if (name[1] == '4') {
                int32_t small;
                memcpy(&small, data, 4);
                number = name[0] == 'u' ? (int64_t)(uint32_t)small : small;
            } else {
                memcpy(&number, data, 8);
                if (name[0] == 'i') return put(walk, "q", number);
            }
    }
    int64_t *at = put_numbers(walk, 1);
    if (!at) return -1;
    *at = number;
    return put_text(walk, "s", 1) || put_text(walk, name, 2) ? -1 : 0;
}

static int walk_value(Walk *walk, PyObject *value) {
    PyTypeObject *of = Py_TYPE(value);
    if (PyArray_CheckExact(value)) return walk_array(walk, (PyArrayObject *)value);
    if (of == &PyFloat_Type) return walk_float(walk, PyFloat_AsDouble(value));
    if (of == &PyLong_Type) return walk_int(walk, value);
    if (value == Py_None) return put(walk, "n", 0);
    if (of == &PyBool_Type) return put(walk, "b", value == Py_True);
    if (PyTuple_Check(value)) {
        if (put_text(walk, "(", 1)) return -1;
        if (put_kept(walk, kept(type_names, (PyObject *)of, named_class))) return -1;
        if (put_text(walk, ";", 1)) return -1;
        if (Py_EnterRecursiveCall(" in arguments of a kernel")) return -1;
        int failed = 0;
        for (Py_ssize_t n = 0; n < PyTuple_Size(value) && !failed; n++)
            failed = walk_value(walk, PyTuple_GetItem(value, n));
        Py_LeaveRecursiveCall();
        return failed ? -1 : put_text(walk, ")", 1);
    }
    if (PyArray_IsScalar(value, Generic)) return walk_scalar(walk, value);
    walk->is_unknown = 1;
    return 0;
}

/* An argument that is left out: its default is a part of the type. */
static int walk_default(Walk *walk, PyObject *value) {
    PyObject *text = PyObject_Repr(value);
    PyObject *bytes = text ? PyUnicode_AsUTF8String(text) : NULL;
    int failed = !bytes || put_text(walk, "o", 1) || put_kept(walk, bytes) || put_text(walk, ";", 1);
    Py_XDECREF(text);
    Py_XDECREF(bytes);
    return failed ? -1 : 0;
}

/* ---- Results -------------------------------------------------------------------------------- */

static void let_go(PyObject *capsule) { release(PyCapsule_GetPointer(capsule, NULL)); }

static PyObject *made_dtype(PyObject *name) {
    PyArray_Descr *dtype = NULL;
    return PyArray_DescrConverter(name, &dtype) ? (PyObject *)dtype : NULL;
}

/* "A" dtype "," dimensions ";" */
static PyObject *give_array(const char **gives, const int64_t **result) {
    const char *comma = strchr(*gives, ',');
    const int n = atoi(comma + 1);
    const int64_t *number = *result;
    PyObject *name = PyUnicode_FromStringAndSize(*gives, comma - *gives);
    PyObject *dtype = name ? kept(dtypes, name, made_dtype) : NULL;
    Py_XDECREF(name);
    *gives = strchr(comma, ';') + 1;
    *result += 5 + 2 * n;
    void *memory = (void *)(intptr_t)number[0];
    if (!dtype || !memory) {
        if (dtype) PyErr_SetString(PyExc_RuntimeError, "a kernel gives an array that it was given");
        release(memory);
        return NULL;
    }
    npy_intp dims[NPY_MAXDIMS], strides[NPY_MAXDIMS];
    for (int axis = 0; axis < n; axis++) {
        dims[axis] = (npy_intp)number[5 + axis];
        strides[axis] = (npy_intp)number[5 + n + axis];
    }
    PyObject *owner = PyCapsule_New(memory, NULL, let_go);
    if (!owner) {
        release(memory);
        return NULL;
    }
    Py_INCREF(dtype);
    PyObject *array = PyArray_NewFromDescr(&PyArray_Type, (PyArray_Descr *)dtype, n, dims, strides,
                                           (void *)(intptr_t)number[4], NPY_ARRAY_WRITEABLE, NULL);
    if (!array) {
        Py_DECREF(owner);
        return NULL;
    }
    PyArray_UpdateFlags((PyArrayObject *)array, NPY_ARRAY_UPDATE_ALL);
    if (PyArray_SetBaseObject((PyArrayObject *)array, owner)) Py_CLEAR(array);
    return array;
}

static PyObject *give(const char **gives, const int64_t **result);

/* "T" parts ":" class ";" and the parts' own; no class: a tuple. */
static PyObject *give_tuple(const char **gives, const int64_t **result) {
    const long count = atol(*gives);
    const char *name = strchr(*gives, ':') + 1, *end_of_name = strchr(name, ';');
    *gives = end_of_name + 1;
    PyObject *parts = PyTuple_New(count);
    for (long n = 0; n < count && parts; n++) {
        PyObject *part = give(gives, result);
        if (!part || PyTuple_SetItem(parts, n, part)) Py_CLEAR(parts);
    }
    if (!parts || name == end_of_name) return parts;
    const char *dot = end_of_name;
    while (*dot != '.') dot--;
    PyObject *module_name = PyUnicode_FromStringAndSize(name, dot - name);
    PyObject *class_name = PyUnicode_FromStringAndSize(dot + 1, end_of_name - dot - 1);
    PyObject *module = module_name ? PyImport_Import(module_name) : NULL;
    PyObject *of = module && class_name ? PyObject_GetAttr(module, class_name) : NULL;
    PyObject *bundle = of ? PyObject_CallObject(of, parts) : NULL;
    Py_XDECREF(module_name);
    Py_XDECREF(class_name);
    Py_XDECREF(module);
    Py_XDECREF(of);
    Py_DECREF(parts);
    return bundle;
}

static PyObject *give(const char **gives, const int64_t **result) {
    double number;
    float small;
    switch (*(*gives)++) {
        case 'n': (*result)++; Py_RETURN_NONE;
        case 'b': return PyBool_FromLong((long)*(*result)++);
        case 'q': return PyLong_FromLongLong(*(*result)++);
        case 'Q': return PyLong_FromUnsignedLongLong((unsigned long long)*(*result)++);
        case 'd': memcpy(&number, (*result)++, 8); return PyFloat_FromDouble(number);
        case 'f': memcpy(&small, (*result)++, 4); return PyFloat_FromDouble(small);
        case 'A': return give_array(gives, result);
        case 'T': return give_tuple(gives, result);
    }
    PyErr_SetString(PyExc_SystemError, "the library of kernels is damaged");
    return NULL;
}

/* What a kernel raised: its first result points at what numba made of it. */
static PyObject *fail(int status, const int64_t *result) {
    typedef struct {
        const char *data;
        int32_t size;
    } Raised;
    if (status == PYTHON_ERROR && PyErr_Occurred()) return NULL;
    const Raised *raised = status >= USER_ERROR ? (const Raised *)(intptr_t)result[0] : NULL;
    for (int n = 0; raised && n < FAILURE_COUNT; n++) {
        const Failure *known = &FAILURES[n];
        if (known->size != (size_t)raised->size || memcmp(known->pickled, raised->data, known->size))
            continue;
        PyObject *builtins = PyImport_ImportModule("builtins");
        PyObject *of = builtins ? PyObject_GetAttrString(builtins, known->name) : NULL;
        if (of) PyErr_SetString(of, known->message);
        Py_XDECREF(of);
        Py_XDECREF(builtins);
        return NULL;
    }
    PyErr_Format(PyExc_RuntimeError, "a kernel failed with status %d", status);
    return NULL;
}

/* ---- Kernels -------------------------------------------------------------------------------- */

typedef struct {
    PyObject_HEAD
    const Entry *first;
    int count;
    char *is_admitted; /* of each entry: whether it is of the sources that are there */
    PyObject *names;   /* of the parameters */
    PyObject *defaults; /* of the last of them */
} Kernel;

/* Walks a call's arguments. 0; -1: an error is set. */
static int walk_call(Walk *walk, Kernel *kernel, PyObject *args, PyObject *kwargs) {
    const Py_ssize_t given = PyTuple_Size(args), count = PyTuple_Size(kernel->names);
    Py_ssize_t named = kwargs && kwargs != Py_None ? PyDict_Size(kwargs) : 0;
    for (Py_ssize_t n = 0; n < given; n++)
        if (walk_value(walk, PyTuple_GetItem(args, n))) return -1;
    for (Py_ssize_t n = given; n < count; n++) {
        PyObject *value = NULL;
        if (named) {
            value = PyDict_GetItemWithError(kwargs, PyTuple_GetItem(kernel->names, n));
            if (!value && PyErr_Occurred()) return -1;
        }
        const Py_ssize_t from_end = count - n, defaults = PyTuple_Size(kernel->defaults);
        if (value) {
            named--;
            if (walk_value(walk, value)) return -1;
        } else if (from_end <= defaults) {
            value = PyTuple_GetItem(kernel->defaults, defaults - from_end);
            if (walk_default(walk, value)) return -1;
        } else {
            walk->is_unknown = 1;
        }
    }
    walk->is_unknown |= given > count || named != 0; /* numba says what is wrong */
    return 0;
}

/* Position of the entry for the types that a walk has met; -1: none. */
static int entry_of(const Kernel *kernel, const Walk *walk) {
    for (int n = 0; n < kernel->count && !walk->is_unknown; n++) {
        const Entry *entry = &kernel->first[n];
        if (strncmp(entry->key, walk->key, walk->key_size) || entry->key[walk->key_size]) continue;
        return entry->count == (int)walk->count ? n : -1;
    }
    return -1;
}

static PyObject *kernel_call(PyObject *self, PyObject *given, PyObject *unused) {
    Kernel *kernel = (Kernel *)self;
    PyObject *args, *kwargs, *answer = NULL;
    Walk walk;
    int64_t result[RESULTS];
    (void)unused;
    if (!PyArg_ParseTuple(given, "O!O", &PyTuple_Type, &args, &kwargs)) return NULL;
    begin(&walk);
    if (!walk_call(&walk, kernel, args, kwargs)) {
        const int n = entry_of(kernel, &walk);
        if (n < 0 || !kernel->is_admitted[n]) {
            answer = Py_NewRef(Py_NotImplemented);
        } else {
            const Entry *entry = &kernel->first[n];
            int status;
            const Run run = is_wide && entry->wide ? entry->wide : entry->run;
            Py_BEGIN_ALLOW_THREADS
            status = run(walk.number, result);
            Py_END_ALLOW_THREADS
            const char *gives = entry->gives;
            const int64_t *at = result;
            answer = status == 0 || status == -2 ? give(&gives, &at) : fail(status, result);
        }
    }
    end(&walk);
    return answer;
}

/* Position and sources of the entry for a call's arguments; None: there is none. */
static PyObject *kernel_match(PyObject *self, PyObject *given) {
    Kernel *kernel = (Kernel *)self;
    PyObject *args, *kwargs, *answer = NULL;
    Walk walk;
    if (!PyArg_ParseTuple(given, "O!O", &PyTuple_Type, &args, &kwargs)) return NULL;
    begin(&walk);
    if (!walk_call(&walk, kernel, args, kwargs)) {
        const int n = entry_of(kernel, &walk);
        answer = n < 0 ? Py_NewRef(Py_None) : Py_BuildValue("is", n, kernel->first[n].sources);
    }
    end(&walk);
    return answer;
}

/* The types of a call's arguments, as keys name them; for tests. */
static PyObject *kernel_key(PyObject *self, PyObject *given) {
    PyObject *args, *kwargs, *answer = NULL;
    Walk walk;
    if (!PyArg_ParseTuple(given, "O!O", &PyTuple_Type, &args, &kwargs)) return NULL;
    begin(&walk);
    if (!walk_call(&walk, (Kernel *)self, args, kwargs))
        answer = walk.is_unknown ? Py_NewRef(Py_None)
                                 : PyUnicode_FromStringAndSize(walk.key, (Py_ssize_t)walk.key_size);
    end(&walk);
    return answer;
}

static PyObject *kernel_admit(PyObject *self, PyObject *position) {
    Kernel *kernel = (Kernel *)self;
    const long n = PyLong_AsLong(position);
    if (n == -1 && PyErr_Occurred()) return NULL;
    if (n < 0 || n >= kernel->count) {
        PyErr_Format(PyExc_IndexError, "%ld of %d entries", n, kernel->count);
        return NULL;
    }
    kernel->is_admitted[n] = 1;
    Py_RETURN_NONE;
}

static void kernel_free(PyObject *self) {
    Kernel *kernel = (Kernel *)self;
    PyTypeObject *of = Py_TYPE(self);
    Py_XDECREF(kernel->names);
    Py_XDECREF(kernel->defaults);
    free(kernel->is_admitted);
    ((freefunc)PyType_GetSlot(of, Py_tp_free))(self);
    Py_DECREF(of);
}

static PyMethodDef kernel_methods[] = {
    {"match", kernel_match, METH_VARARGS, "Position and sources of the entry for arguments."},
    {"key", kernel_key, METH_VARARGS, "Types of arguments, as keys name them."},
    {"admit", kernel_admit, METH_O, "Let an entry be run from now on."},
    {NULL, NULL, 0, NULL},
};
static PyType_Slot kernel_slots[] = {
    {Py_tp_call, kernel_call},
    {Py_tp_dealloc, kernel_free},
    {Py_tp_methods, kernel_methods},
    {0, NULL},
};
static PyType_Spec kernel_spec = {
    "resample.engine.compiled._kernels.Kernel", sizeof(Kernel), 0,
    Py_TPFLAGS_DEFAULT | Py_TPFLAGS_DISALLOW_INSTANTIATION, kernel_slots};
static PyTypeObject *kernel_type;

/* A kernel by its name, with its parameters and the defaults of the last; None: unknown. */
static PyObject *find(PyObject *module, PyObject *given) {
    const char *name;
    PyObject *names, *defaults;
    int low = 0, high = ENTRY_COUNT, last;
    (void)module;
    if (!PyArg_ParseTuple(given, "sO!O!", &name, &PyTuple_Type, &names, &PyTuple_Type, &defaults))
        return NULL;
    while (low < high) {
        const int middle = (low + high) / 2;
        if (strcmp(ENTRIES[middle].kernel, name) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    for (last = low; last < ENTRY_COUNT && !strcmp(ENTRIES[last].kernel, name);) last++;
    if (low == last) Py_RETURN_NONE;
    allocfunc make = (allocfunc)PyType_GetSlot(kernel_type, Py_tp_alloc);
    Kernel *kernel = (Kernel *)make(kernel_type, 0);
    if (!kernel) return NULL;
    kernel->first = &ENTRIES[low];
    kernel->count = last - low;
    kernel->names = Py_NewRef(names);
    kernel->defaults = Py_NewRef(defaults);
    kernel->is_admitted = calloc((size_t)(last - low), 1);
    if (!kernel->is_admitted) {
        Py_DECREF(kernel);
        return PyErr_NoMemory();
    }
    return (PyObject *)kernel;
}

/* ---- The module ----------------------------------------------------------------------------- */

/* What kernels may use of a processor, and whether it is there: of x86-64-v3 all, and then the part
   of x86-64-v4. Other processors have what their platform's level asks for. */
typedef struct {
    const char *name;
    int is_there;
} Feature;

#ifdef __x86_64__
#define FEATURES 13
#define OF_V3 8

static void find_features(Feature *features) {
    unsigned a = 0, b = 0, c = 0, d = 0, first = 0, extended = 0, seven = 0, saved = 0;
    if (__get_cpuid(1, &a, &b, &c, &d)) first = c;
    if (__get_cpuid_count(7, 0, &a, &b, &c, &d)) seven = b;
    if (__get_cpuid(0x80000001, &a, &b, &c, &d)) extended = c;
    if (first & bit_OSXSAVE) __asm__("xgetbv" : "=a"(saved), "=d"(d) : "c"(0));
    /* Registers of AVX and AVX-512 that the system saves. */
    const int is_saved = (saved & 0x06) == 0x06, is_wide_saved = (saved & 0xe6) == 0xe6;
    const Feature found[FEATURES] = {
        {"AVX2", is_saved && (seven & bit_AVX2)},
        {"FMA", is_saved && (first & bit_FMA)},
        {"BMI1", (seven & bit_BMI) != 0},
        {"BMI2", (seven & bit_BMI2) != 0},
        {"F16C", is_saved && (first & bit_F16C)},
        {"MOVBE", (first & bit_MOVBE) != 0},
        {"POPCNT", (first & bit_POPCNT) != 0},
        {"LZCNT", (extended & bit_LZCNT) != 0},
        {"AVX512F", is_wide_saved && (seven & bit_AVX512F)},
        {"AVX512BW", is_wide_saved && (seven & bit_AVX512BW)},
        {"AVX512CD", is_wide_saved && (seven & bit_AVX512CD)},
        {"AVX512DQ", is_wide_saved && (seven & bit_AVX512DQ)},
        {"AVX512VL", is_wide_saved && (seven & bit_AVX512VL)},
    };
    memcpy(features, found, sizeof found);
}
#else
#define FEATURES 0
#define OF_V3 0

static void find_features(Feature *features) { (void)features; }
#endif

/* Names of what the kernels' level has and this processor, or its system, has not. */
static PyObject *lacking(PyObject *module, PyObject *unused) {
    Feature features[FEATURES + 1];
    (void)module;
    (void)unused;
    find_features(features);
    PyObject *names = PyList_New(0);
    for (int n = 0; names && n < OF_V3; n++) {
        PyObject *name = features[n].is_there ? NULL : PyUnicode_FromString(features[n].name);
        if (name && PyList_Append(names, name)) Py_CLEAR(names);
        Py_XDECREF(name);
    }
    return names;
}

static int has_v4(void) {
    Feature features[FEATURES + 1];
    find_features(features);
    for (int n = 0; n < FEATURES; n++)
        if (!features[n].is_there) return 0;
    return FEATURES > 0;
}

/* All entries: kernel, types of arguments. */
static PyObject *entries(PyObject *module, PyObject *unused) {
    PyObject *all = PyList_New(0);
    (void)module;
    (void)unused;
    for (int n = 0; all && n < ENTRY_COUNT; n++) {
        PyObject *entry = Py_BuildValue("ss", ENTRIES[n].kernel, ENTRIES[n].key);
        if (!entry || PyList_Append(all, entry)) Py_CLEAR(all);
        Py_XDECREF(entry);
    }
    return all;
}

static PyObject *set_dtype_name(PyObject *module, PyObject *function) {
    (void)module;
    Py_XDECREF(dtype_name);
    dtype_name = Py_NewRef(function);
    Py_RETURN_NONE;
}

static PyMethodDef methods[] = {
    {"find", find, METH_VARARGS, "A kernel by its name; None if there is none."},
    {"entries", entries, METH_NOARGS, "Names of all kernels, and types of their arguments."},
    {"lacking", lacking, METH_NOARGS, "What the code needs of a processor and this one lacks."},
    {"set_dtype_name", set_dtype_name, METH_O, "Take a function that names dtypes."},
    {NULL, NULL, 0, NULL},
};
static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_kernels", "Kernels that were compiled ahead.", -1, methods,
    NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__kernels(void) {
    import_array();
    is_wide = has_v4();
    type_names = PyDict_New();
    dtype_names = PyDict_New();
    dtypes = PyDict_New();
    kernel_type = (PyTypeObject *)PyType_FromSpec(&kernel_spec);
    if (!type_names || !dtype_names || !dtypes || !kernel_type) return NULL;
    return PyModule_Create(&definition);
}
