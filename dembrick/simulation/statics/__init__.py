"""Equilibria and limit loads in the geometry of the start: artificial inertia for one block, Newton for assemblies.

Input is an ``Assembly``; output are a record of the load path and the bracket of the limit load.
"""
