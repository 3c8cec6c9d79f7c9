"""The command line: one verb a stage, each a few lines that call the stage's public function."""

import logging
import os
import signal
import sys
import warnings
from typing import Any

from mixpinn.cli.stopping import exit_code, hear_signals

__all__ = ["app", "main"]

_INTERRUPTED = 128 + signal.SIGINT
_SHOWN = 300
"""Letters of a path that a message shows."""


def __getattr__(name: str) -> Any:
    """`app` is imported when it is asked for, so that `main` is there before anything can be interrupted."""
    if name != "app":
        raise AttributeError(f"module 'mixpinn.cli' has no attribute {name!r}")
    return _application()


def main() -> None:
    """Run the command line; whatever a user can mend is said in one line, with exit code 2."""
    # What libraries log and warn of beside their errors (VTK at length) is said here in one line.
    logging.basicConfig(handlers=[logging.NullHandler()])
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    _print_on_any_terminal()
    hear_signals()
    try:
        _stand_somewhere()
        _run()
    except KeyboardInterrupt:
        _leave("stopped; the same command goes on from here", exit_code())


def _run() -> None:
    from mixpinn.base.errors import MixpinnError, SolveError
    from mixpinn.base.files import NO_PATH, NO_RIGHT, NO_ROOM

    try:
        _refuse_empty_words(sys.argv[1:])
        sys.exit(_application()(standalone_mode=True) or 0)
    except SystemExit as end:
        if end.code == _INTERRUPTED:  # typer makes an exit of the interruption
            raise KeyboardInterrupt from end
        raise
    except SolveError as error:
        _leave(str(error), 1)
    except MixpinnError as error:
        _leave(str(error), 2)
    except MemoryError as error:
        _leave(f"the memory at hand is not enough ({' '.join(str(error).split()) or 'no size known'}); ask for less", 2)
    except OSError as error:
        if error.errno in NO_RIGHT:
            _leave(f"{error.filename or 'output'}: {error.strerror}; check its permissions or choose another folder", 2)
        if error.errno in NO_ROOM:
            _leave(f"{error.filename or 'output'}: {error.strerror}; free some space or choose another folder", 2)
        if error.errno not in NO_PATH or error.filename is None:
            raise
        _leave(f"{str(error.filename)[:_SHOWN]}: {error.strerror}; check the path", 2)


def _stand_somewhere() -> None:
    """Libraries end the process where the current folder is gone, each in words of its own."""
    try:
        os.getcwd()
    except FileNotFoundError:
        print("mixpinn: the current folder was removed; change to another one", file=sys.stderr)
        sys.exit(2)


def _refuse_empty_words(words: list[str]) -> None:
    """An empty path would be the current folder, and an empty name any; it comes from a variable that is not set."""
    from mixpinn.base.errors import InputError

    for index, word in enumerate(words):
        if not word.strip() or (word.startswith("--") and word.endswith("=")):
            place = f"after {words[index - 1]!r}" if index and not word.strip() else f"for {word!r}"
            raise InputError(
                "command line", expected="words that are not empty", got=f"nothing {place}",
                fix="check the variables of the shell in it",
            )


def _application() -> Any:
    # They add their verbs to the application.
    from mixpinn.cli import assess_verb, live_verbs, model_verbs, run_verbs, stream_verb  # noqa: F401
    from mixpinn.cli.data_verbs import app

    return app


def _print_on_any_terminal() -> None:
    """Signs that the terminal's encoding lacks are replaced; a stream that was closed is one that nobody reads."""
    sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 (for as long as the process)
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="replace")


def _leave(message: str, code: int) -> None:
    from mixpinn.base.rundir import withdraw_unused_runs

    withdraw_unused_runs()
    print(f"mixpinn: {message}", file=sys.stderr)
    sys.exit(code)
