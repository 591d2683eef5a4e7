"""The two engines, without files: ``statics`` finds equilibria and limit loads, ``dynamics`` steps in time.

Input is an ``Assembly``; output are records, bounds of the load and collapses. Both share the session (interrupts,
progress, checkpoints) and the energy audit. Nothing here writes files or depends on closed-form theory.
"""
