"""Whole runs: from a scenario to a result with its error bar, its history file, and its comparison with theory.

``simulate.simulate`` is the entry point; ``lab``, ``fit``, ``domain`` and ``study`` call it many times. This package
decides what is run, recorded, compared and written; engines and views do not depend on each other.
"""
