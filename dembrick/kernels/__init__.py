"""Compiled kernels, each importing only from those before it: vec3 < laws, limit_surface < contact < small_motion,
finite_motion < forces < bracket, energy, record < advance. Nothing else of the package is imported but _jit.
"""
