"""Child processes that tests start."""

import signal

PATIENCE = 600.0
"""After which a child hangs [s], on a machine that others use, too; a test that passes does not wait for it."""


def hear_interrupts() -> None:
    """Ctrl-C is heard even where the tests run in the background of a shell, which has it ignored: a ``preexec_fn``."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
