"""Kernels in both forms, compiled and as plain Python."""

import numpy as np


def forms(function):
    """The kernel compiled and as plain Python (twice the plain one if compiling is turned off)."""
    return [function, getattr(function, "py_func", function)]


def matrix(h11, h12, h22, h13, h23, h33):
    return np.array([[h11, h12, h13], [h12, h22, h23], [h13, h23, h33]])
