"""Polygons, convex hulls, rotations and meshes: plane and solid geometry on numpy arrays.

What goes in are vertices (n, 2) or (n, 3) in m; what comes out are areas, centroids, moments, clipped polygons, convex
parts and mesh faces. Nothing here knows of blocks, joints or scenarios; only ``mesh_file`` reads files.
"""
