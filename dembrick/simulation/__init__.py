"""The two engines, without files: ``statics`` finds equilibria and limit loads, ``dynamics`` steps in time.

An ``Assembly`` goes in; records, bounds of the load and collapses come out. Shared are the session (interrupts,
progress, checkpoints) and the energy audit. Nothing here writes a file or knows of theory.
"""
