"""Real-time, physics-informed simulation of soft tissue with rigid bodies inside."""

__version__ = "0.1.0"
