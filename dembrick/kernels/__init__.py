"""Compiled kernels: the arrays of a state and all laws that work on them, in numba.

``math`` (vectors, multifrontal factors) and ``joint`` (laws of a joint) serve both engines, which do not import each
other: ``statics`` (equilibria in the geometry of the start) and ``dynamics`` (true mass, large rotations, contacts).
Arguments and results are NamedTuples of arrays; a kernel allocates nothing. From the rest of the package only ``_jit``
is imported.
"""
