"""Ctrl-C and SIGTERM: one interruption, at a moment at which it can be taken, and the exit code that belongs to it."""

import atexit
import contextlib
import os
import signal
import threading
import time
from importlib.machinery import ExtensionFileLoader
from types import FrameType

_PAUSE, _LONGEST = 0.01, 2.0
"""Where it cannot be taken it comes again after the first, for no longer than the second [s]."""
_UNSAFE, _OWN = "numba.", "mixpinn."
_stopped_by = [signal.SIGINT]
"""The signal that stops this process, for its exit code."""
_put_off_since: list[float] = []


def hear_signals() -> None:
    """Have SIGTERM and SIGINT end this process by a `KeyboardInterrupt`; a SIGINT that is ignored stays so."""
    with contextlib.suppress(ValueError):  # not the main thread: whoever started it handles its signals
        signal.signal(signal.SIGTERM, _interrupt)
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, _interrupt)
        atexit.register(_hear_no_more)


def exit_code() -> int:
    """Exit code of a process that was stopped: 128 and the number of the signal."""
    # Where the source text of an `exec` was interrupted (classes are made so), Python would end itself by SIGINT after
    # all that is said and done; the next text makes it forget.
    exec("")
    return 128 + _stopped_by[0]


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Raise `KeyboardInterrupt`, but not where machine code would overlook an exception or stumble over it.

    Numba finds out in Python of what kind the arguments of a compiled function are, and runs it all the same; VTK and
    others import modules while they are loaded. What followed were a `SystemError`, an `ImportError` or a segmentation
    fault.
    """
    if _calls_compiled_code(frame) or _loads_extension(frame):
        began = _put_off_since[0] if _put_off_since else time.monotonic()
        if time.monotonic() - began < _LONGEST:  # what takes longer compiles, and can be interrupted
            _put_off_since[:] = [began]
            again = threading.Timer(_PAUSE, os.kill, (os.getpid(), number))
            again.daemon = True
            again.start()
            return
    _put_off_since.clear()
    _stopped_by[0] = signal.Signals(number)
    raise KeyboardInterrupt


def _calls_compiled_code(frame: FrameType | None) -> bool:
    """Whether the innermost frames are Numba's."""
    while frame is not None:
        name = str(frame.f_globals.get("__name__", ""))
        if name.startswith((_UNSAFE, _OWN)):
            return name.startswith(_UNSAFE)
        frame = frame.f_back
    return False


def _loads_extension(frame: FrameType | None) -> bool:
    """Whether a module of machine code is being loaded."""
    while frame is not None:
        if frame.f_code.co_name in ("create_module", "exec_module") and isinstance(
            frame.f_locals.get("self"), ExtensionFileLoader,
        ):
            return True
        frame = frame.f_back
    return False


def _hear_no_more() -> None:
    """Everything is done by now, and Python would answer a signal by itself, with a traceback."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
