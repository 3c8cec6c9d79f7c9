"""Hurried contact: the same answers as patient contact, or none."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from mixpinn.press.hurried import HurriedContact, LostTrackError
from serving.live.pressed import above, block_predictor


@pytest.fixture(scope="module")
def model():
    return block_predictor().pressing


def _place(pose):
    return pose.rotation[None], pose.translation[None]


def test_what_it_answers_is_what_patient_contact_answers(model) -> None:
    contact, probes = model.contact, [model.probes[0]]
    hurried = HurriedContact.of(contact)
    first = contact.solve(probes, *_place(above(x=14.0, depth=4.0)))
    there = _place(above(x=14.5, depth=4.2))
    patient, soon = (one.solve(probes, *there, history=first.history) for one in (contact, hurried))
    assert soon.converged
    assert_array_equal(soon.displacement, patient.displacement)
    assert_array_equal(soon.wrench, patient.wrench)
    assert_array_equal(hurried.solve(probes, *there).wrench, contact.solve(probes, *there).wrench)


@pytest.mark.parametrize("hard", ["iterations", "budget"])
def test_it_gives_up_where_patient_contact_tries_on(model, monkeypatch, hard) -> None:
    contact, probes = model.contact, [model.probes[0]]
    hurried = HurriedContact.of(contact)
    first = contact.solve(probes, *_place(above(x=14.0, depth=4.0)))
    if hard == "iterations":
        hurried.config = replace(hurried.config, max_iterations=1)
    else:
        monkeypatch.setattr("mixpinn.press.hurried._ENOUGH", 3)
    with pytest.raises(LostTrackError):
        hurried.solve(probes, *_place(above(x=24.0, depth=6.0)), history=first.history)
    assert np.isfinite(contact.solve(probes, *_place(above(x=24.0, depth=6.0)), history=first.history).wrench).all()
