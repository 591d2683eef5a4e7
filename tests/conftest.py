"""What several test modules ask for by name."""

import os
import signal

import pytest

from dembrick.simulation import interrupts
from dembrick.simulation.statics import stepper

pytest.register_assert_rewrite("helpers")


@pytest.fixture
def stop_after(monkeypatch):
    """Chunks of one step, and a way to have a signal come after so many of them; without waiting for the disk."""
    monkeypatch.setattr(os, "fsync", lambda _: None)
    monkeypatch.setattr(stepper, "FIRST_WORK", 1)
    monkeypatch.setattr(stepper, "CHUNK_SECONDS", 0.0)

    def arm(chunks, signum=signal.SIGINT):
        left = [chunks]

        def requested():
            left[0] -= 1
            return signum if left[0] == 0 else 0

        monkeypatch.setattr(interrupts, "requested", requested)

    return arm
