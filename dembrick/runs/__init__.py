"""Whole runs: from a scenario to a result with its error bar, its history file, and its comparison with theory.

``simulate.simulate`` is the entrance; ``lab``, ``fit``, ``domain`` and ``study`` make many runs of it. Everything that
decides what is run, kept, judged and written together lives here; engines and views know nothing of each other.
"""
