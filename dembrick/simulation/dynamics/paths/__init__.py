"""Equilibria in the deformed geometry: supports that settle, loads that grow, actuators that drive."""
