"""A predictor that answers request after request: always the same answer, and no memory lost."""

import resource

import numpy as np

from mixpinn.serving import load_predictor


def peak_memory():
    """Largest resident size of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def test_answers_stay_the_same_and_memory_stays_level(chain, drill):
    predictor = load_predictor(chain.model, threads=1)
    nodes = np.flatnonzero((predictor.mesh.part == 0) & ~predictor.mesh.fixed)[:6]
    rng = np.random.default_rng(0)
    requests = rng.normal(scale=1.0, size=(5, len(nodes), 3))
    first = [predictor.predict_at(nodes, request).displacement for request in requests]
    before = peak_memory()
    for round_ in range(10_000 if drill else 40):
        which = round_ % len(requests)
        np.testing.assert_array_equal(predictor.predict_at(nodes, requests[which]).displacement, first[which])
    assert peak_memory() - before < 50.0
