"""Rigid-block limit analysis: bounds of the load factor by conic programming, static theorem, associative flow.

Input is an ``Assembly``; output are the limit of its load with certified lower and upper bounds, the joint
forces of the former and the mechanism of the latter, and likewise the least and the greatest reaction of a support.
Stiffness, time and the engines' kernels play no part: only the strengths of the joints count. ``analysis`` is the entry
point; ``solver`` is the only module that uses the optional packages clarabel and scipy.
"""
