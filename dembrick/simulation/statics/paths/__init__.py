"""Limit loads of assemblies from equilibrium to equilibrium: which step is next, what an equilibrium says of the limit,
and what helps where Newton's method finds no way."""
