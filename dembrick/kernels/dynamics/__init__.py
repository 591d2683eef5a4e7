"""Kernels of motion in real time: rigid bodies, joints that move, contacts that form, energy, the loop."""
