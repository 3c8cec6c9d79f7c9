"""Effort: where the time of solves goes."""

import time
from dataclasses import dataclass, field


@dataclass
class Effort:
    """Where the time of solves goes; every entry adds up over the solver's life."""

    iterations: int = 0
    contact_iterations: int = 0
    factorizations: int = 0
    evaluations: int = 0
    seconds: dict[str, float] = field(default_factory=lambda: {
        "assembly": 0.0, "factorization": 0.0, "solve": 0.0, "gradient": 0.0, "contact": 0.0,
    })

    def add(self, phase: str, since: float) -> None:
        """Book the time from `since` (of `time.perf_counter`) until now to `phase`."""
        self.seconds[phase] += time.perf_counter() - since
