// flip_triangles.hpp for Python, through buffers: the triangles (int32) change in place.
// SPDX-License-Identifier: MIT

#include <Python.h>

#include <new>

#include "flip_triangles.hpp"

namespace {

std::size_t count_indices(const Py_buffer& triangles) {
    return static_cast<std::size_t>(triangles.len) / sizeof(std::int32_t);
}

/** Call a function without Python's lock; release the buffers. Return false after an exception. */
template <class Function>
bool call(Function function, Py_buffer* first, Py_buffer* second = nullptr) {
    PyObject* kind = PyExc_ValueError;
    const char* message = "triangles or points are too many (max 2^31 indices)";
    PyThreadState* state = PyEval_SaveThread();
    try {
        function();
        kind = nullptr;
    } catch (const std::bad_alloc&) {
        kind = PyExc_MemoryError;
    } catch (const std::out_of_range&) {
        message = "triangles have an index out of range";
    } catch (const std::exception&) {
    }
    PyEval_RestoreThread(state);
    PyBuffer_Release(first);
    if (second) PyBuffer_Release(second);
    if (kind) PyErr_SetString(kind, message);
    return !kind;
}

PyObject* flip(PyObject*, PyObject* arguments) {
    Py_buffer triangles, points;
    int by, walk;
    double scale;
    if (!PyArg_ParseTuple(arguments, "w*y*ipd", &triangles, &points, &by, &walk, &scale)) return nullptr;
    std::size_t flips = 0;
    const bool done = call([&] {
        const auto order = walk ? flip_triangles::Order::walk : flip_triangles::Order::native;
        flips = flip_triangles::flip(static_cast<std::int32_t*>(triangles.buf), count_indices(triangles),
                                     static_cast<const double*>(points.buf),
                                     static_cast<std::size_t>(points.len) / (2 * sizeof(double)),
                                     static_cast<flip_triangles::By>(by), std::size_t(2), order, scale);
    }, &triangles, &points);
    return done ? PyLong_FromSize_t(flips) : nullptr;
}

PyObject* reorder(PyObject*, PyObject* arguments) {
    Py_buffer triangles;
    Py_ssize_t points;
    if (!PyArg_ParseTuple(arguments, "w*n", &triangles, &points)) return nullptr;
    const bool done = call([&] {
        flip_triangles::reorder(static_cast<std::int32_t*>(triangles.buf), count_indices(triangles),
                                static_cast<std::size_t>(points < 0 ? 0 : points));
    }, &triangles);
    return done ? Py_NewRef(Py_None) : nullptr;
}

PyMethodDef functions[] = {
    {"flip", flip, METH_VARARGS, "flip(triangles, points, by, walk, scale): return the number of flips"},
    {"reorder", reorder, METH_VARARGS, "reorder(triangles, points)"},
    {nullptr, nullptr, 0, nullptr},
};

PyModuleDef module = {PyModuleDef_HEAD_INIT, "_flip", nullptr, -1, functions, nullptr, nullptr, nullptr, nullptr};

}  // namespace

PyMODINIT_FUNC PyInit__flip() { return PyModule_Create(&module); }
