"""Rigid-block limit analysis: bounds of the load factor by conic programming, static theorem, associative flow.

An ``Assembly`` goes in; out come the limit of its load with a lower and an upper bound that are proven, the joint
forces of the one and the mechanism of the other, and likewise the least and the greatest reaction of a support.
Stiffness, time and the engines' kernels play no part: the joints are their strengths. ``analysis`` is the entrance;
``solver`` is the only module that knows the optional packages clarabel and scipy.
"""
