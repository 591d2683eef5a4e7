"""The scenario of a laboratory test: a block on a fixed one, pressed, and pushed by a jack off its centre."""

BLOCKS = """
title   = "Two blocks and a jack"
gravity = [0.0, 0.0, -9.81]
[joint]
formulation      = "convex"
friction         = 0.62
normal_stiffness = 1.0e10
shear_stiffness  = 4.0e9
[materials.granite]
density = 2600.0
[[blocks]]
name     = "lower"
material = "granite"
box      = [0.4, 0.2, 0.15]
position = [0.0, 0.0, -0.075]
fixed    = true
[[blocks]]
name     = "upper"
material = "granite"
box      = [0.4, 0.2, 0.15]
position = [0.0, 0.0, 0.075]
[[loads]]
block = "upper"
force = [0.0, 0.0, -1500.0]
[[actuators]]
name      = "jack"
block     = "upper"
point     = [0.12, 0.0, 0.075]
direction = [0.0, 1.0, 0.0]
[control]
kind      = "yield"
tolerance = 1.0e-3
"""
