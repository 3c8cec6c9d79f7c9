"""The command line: one verb a stage, each a few lines that call the stage's public function."""

import logging
import sys
import warnings

from mixpinn.base.errors import MixpinnError
from mixpinn.base.files import NO_ROOM
from mixpinn.base.rundir import withdraw_unused_runs
from mixpinn.cli import model_verbs, run_verbs  # noqa: F401 (they add their verbs to the application)
from mixpinn.cli.app import app

__all__ = ["app", "main"]


def main() -> None:
    """Run the command line; whatever a user can mend is said in one line, with exit code 2."""
    # What libraries log and warn of beside their errors (VTK at length) is said here in one line.
    logging.basicConfig(handlers=[logging.NullHandler()])
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    try:
        sys.exit(app(standalone_mode=True) or 0)
    except MixpinnError as error:
        _leave(str(error), 2)
    except OSError as error:
        if error.errno not in NO_ROOM:
            raise
        _leave(f"{error.filename or 'output'}: {error.strerror}; free some space or choose another folder", 2)
    except KeyboardInterrupt:
        _leave("stopped; the same command continues from here", 130)


def _leave(message: str, code: int) -> None:
    withdraw_unused_runs()
    print(f"mixpinn: {message}", file=sys.stderr)
    sys.exit(code)
