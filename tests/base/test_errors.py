"""Errors that a user can mend, on their way between processes."""

import pickle

from mixpinn.base.errors import InputError


def test_an_error_comes_through_a_pipe_as_it_was() -> None:
    error = InputError("tips", expected="three numbers", got="two", fix="give one more")
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), vars(again)) == (str(error), vars(error))
