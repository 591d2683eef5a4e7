"""Limit loads of assemblies by path following: choice of steps, bounds of the limit from equilibria, and methods for
cases in which Newton's method fails."""
