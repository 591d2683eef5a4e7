"""Equilibrium under dead loads: by relaxation, else by viscous motion, which finds it or a collapse mechanism."""
