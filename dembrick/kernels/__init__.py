"""Compiled kernels: vec3 < laws, limit_surface < contact < motion < advance. Nothing else of the package is imported."""
