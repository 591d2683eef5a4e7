"""Vectors of three floats, and factors of banded and skyline matrices, for kernels."""
