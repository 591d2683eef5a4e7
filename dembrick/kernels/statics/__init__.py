"""Kernels of equilibria and limit loads in the geometry of the start: forces, Newton matrices, load bounds, loop."""
