"""The finer skin is solved once and kept in the cache; what is damaged there is made anew."""

import pytest
from numpy.testing import assert_allclose, assert_array_equal

from mixpinn.base.cache import cache_folder
from mixpinn.fem import LocalRefinement, SuperLUSolver
from mixpinn.reduced.prior import ElasticPrior
from mixpinn.stages import fine_skin
from reduced.pressed_block import TISSUE, top_nodes
from training.toy_block import block_mesh

EDGES = LocalRefinement(9.0, 1.0)


@pytest.fixture(scope="module")
def prior():
    mesh = block_mesh().with_order(2)
    return ElasticPrior.build(mesh, [TISSUE], nodes=top_nodes(mesh), linear=SuperLUSolver())


def test_it_is_solved_once(prior, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("MIXPINN_CACHE", str(tmp_path))
    solved = []

    def build(*arguments):
        solved.append(arguments)
        return whole(*arguments)

    whole = fine_skin.build_fine_skin
    monkeypatch.setattr(fine_skin, "build_fine_skin", build)
    first = fine_skin.cached_fine_skin(prior, [TISSUE], EDGES)
    again = fine_skin.cached_fine_skin(prior, [TISSUE], EDGES)
    assert len(solved) == 1
    for name, value in vars(first).items():
        assert_array_equal(getattr(again, name), value, err_msg=name)
    assert solved[0][2].edge == pytest.approx(1.4 * EDGES.edge)
    fine_skin.cached_fine_skin(prior, [TISSUE], LocalRefinement(8.0, 1.0))
    assert len(solved) == 2  # another skin
    kept = sorted(cache_folder("fine_skin", "").glob("**/*.safetensors"))
    assert len(kept) == 2
    for file in kept:
        file.write_bytes(file.read_bytes()[:100])
    mended = fine_skin.cached_fine_skin(prior, [TISSUE], EDGES)
    assert len(solved) == 3
    assert_allclose(mended.more, first.more, rtol=1e-6)


def test_its_faces_cover_those_of_the_candidates_and_no_others(prior) -> None:
    skin = fine_skin.build_fine_skin(prior, [TISSUE], EDGES)
    a, b, c = (skin.places[skin.faces[:, corner]] for corner in range(3))
    area = 0.5 * abs((b[:, 2] - a[:, 2]) * (c[:, 0] - a[:, 0]) - (b[:, 0] - a[:, 0]) * (c[:, 2] - a[:, 2])).sum()
    assert area == pytest.approx(40.0 * 40.0)  # the top of the block
    assert_allclose(skin.places[:, 1], 40.0)
    assert_allclose(skin.weights.sum(axis=1), 1.0, atol=1e-6)
    nodes = prior.mesh.node_points[prior.nodes]
    assert_allclose((skin.weights[..., None] * nodes[skin.stencil]).sum(axis=1), skin.places, atol=1e-5)
