"""Vectors of three floats, and multifrontal factors of sparse matrices, for kernels."""
