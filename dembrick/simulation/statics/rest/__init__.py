"""Rest under dead loads: relaxation, viscous motion where that finds none, and what falls."""
