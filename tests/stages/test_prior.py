from dataclasses import replace

import numpy as np
import pytest

from mixpinn.dataset import SimulationStore
from mixpinn.stages.prior import cached_prior


@pytest.fixture
def store(chain):
    return SimulationStore.open(chain.simulation / "store")


def test_prior_is_kept_and_made_anew_where_the_cache_is_damaged(store, tmp_path, monkeypatch):
    monkeypatch.setenv("MIXPINN_CACHE", str(tmp_path))
    first = cached_prior(store.mesh(), store.materials())
    for path in tmp_path.rglob("*"):
        if path.is_file():
            path.write_bytes(path.read_bytes()[:-9])
    second = cached_prior(store.mesh(), store.materials())
    third = cached_prior(store.mesh(), store.materials())
    np.testing.assert_array_equal(first.compliance.matrix, second.compliance.matrix)
    np.testing.assert_array_equal(first.compliance.matrix, third.compliance.matrix)


def test_an_inexact_prior_of_an_earlier_version_is_made_anew(store, tmp_path, monkeypatch):
    monkeypatch.setenv("MIXPINN_CACHE", str(tmp_path))
    exact = cached_prior(store.mesh(), store.materials())
    folder = next(tmp_path.rglob("prior.json")).parent
    replace(exact, missed=0.01).save(folder)
    assert cached_prior(store.mesh(), store.materials()).missed == 0.0


class Unknown:
    """A material of the user's own, whose constants nobody can see."""

    def __init__(self, known):
        self.energy, self.gradient, self.hessian = known.energy, known.gradient, known.hessian


def test_prior_of_a_material_that_cannot_be_told_is_not_kept(store, tmp_path, monkeypatch):
    monkeypatch.setenv("MIXPINN_CACHE", str(tmp_path))
    (known,) = store.materials()
    prior = cached_prior(store.mesh(), [Unknown(known)])
    assert not list(tmp_path.rglob("*.npy"))
    np.testing.assert_allclose(prior.own_compliance, cached_prior(store.mesh(), [known]).own_compliance, rtol=1e-5)
