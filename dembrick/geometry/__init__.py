"""Polygons, convex hulls, rotations and meshes: plane and solid geometry on numpy arrays.

Input: vertices (n, 2) or (n, 3) in m; output: areas, centroids, moments, clipped polygons, convex parts and mesh faces.
Nothing here knows of joints or scenarios; only the modules called ``*_file`` read files.
"""
