"""Threads and a forked child that share one model get the answers that one thread gets."""

import multiprocessing
import threading

import numpy as np
from numpy.testing import assert_array_equal

from press.test_model import TURN, hybrid, model, tip  # noqa: F401 (fixtures)

PLACES = [tip(x=10.0 + 1.5 * i, depth=1.0 + 0.7 * i) for i in range(8)]


def test_four_threads_answer_as_one_does(model) -> None:  # noqa: F811
    expected = [model.predict(TURN, place).displacement for place in PLACES]
    wrong = np.zeros(4, dtype=np.int64)

    def ask(which):
        for i in np.random.default_rng(which).integers(len(PLACES), size=40):
            wrong[which] += not np.array_equal(model.predict(TURN, PLACES[i]).displacement, expected[i])

    threads = [threading.Thread(target=ask, args=(which,)) for which in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong.any()


def _answer_in_child(model, connection):  # noqa: F811
    connection.send(model.predict(TURN, PLACES[3]).displacement)
    connection.close()


def test_a_forked_child_answers_as_its_parent_does(model) -> None:  # noqa: F811
    expected = model.predict(TURN, PLACES[3]).displacement
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe(duplex=False)
    child = context.Process(target=_answer_in_child, args=(model, there))
    child.start()
    assert here.poll(60.0)
    assert_array_equal(here.recv(), expected)
    child.join(60.0)
    assert child.exitcode == 0
