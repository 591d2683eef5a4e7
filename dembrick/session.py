"""What goes on around a time loop: who gets the record, and what is recorded."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from dembrick.model import Output

Observer = Callable[[Mapping[str, np.ndarray], Mapping[str, np.ndarray]], None]


@dataclass
class Session:
    """Surroundings of a run; without any, it only answers.

    ``observe(rows, frames)`` gets copies of what each chunk of steps brought (see ``recorder``), of the channels of
    ``output``.
    """

    observe: Observer | None = None
    output: Output = field(default_factory=Output)

    @classmethod
    def of(cls, given: Session | Observer | None) -> Session:
        """A session out of a session, of an observer alone, or of nothing."""
        return given if isinstance(given, Session) else cls(observe=given)
