"""Commands that are refused: one line on standard error, exit code 2, nothing half-written."""

from pipeline.chain import command, contents


def refused(*words, says, out=None):
    """Assert that the command is refused with one line that has each of `says`, and leaves no file in `out`."""
    outcome = command(*words)
    assert outcome.code == 2, outcome.err
    last = outcome.lines[-1]
    assert last.startswith("mixpinn: ")
    assert sum(line.startswith("mixpinn: ") for line in outcome.lines) == 1
    assert "Traceback" not in outcome.err
    for text in [says] if isinstance(says, str) else says:
        assert text in last
    if out is not None:
        assert not out.exists() or not contents(out)
