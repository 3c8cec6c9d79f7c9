import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mixpinn.anatomy import Structure
from mixpinn.anatomy.segmentation import common_box, grown_box

from .builders import block, full, segmentation

seeds = st.integers(0, 2**32 - 1)


@given(seeds)
def test_trim_and_window_are_inverse(seed):
    rng = np.random.default_rng(seed)
    mask = rng.random((4, 5, 6)) < 0.1
    structure = Structure.trim("a", mask)
    assert np.array_equal(structure.window((0, 0, 0), (4, 5, 6)), mask)
    assert structure.n_voxels == mask.sum()
    if mask.any():
        assert np.allclose(structure.centroid, np.argwhere(mask).mean(axis=0))


@given(seeds)
def test_window_reaches_beyond_the_box_and_beyond_the_image(seed):
    rng = np.random.default_rng(seed)
    mask = rng.random((4, 5, 6)) < 0.2
    padded = np.pad(mask, 10)
    start, stop = rng.integers(-9, 3, 3), rng.integers(3, 12, 3)
    window = Structure.trim("a", mask).window(tuple(start), tuple(stop))
    assert np.array_equal(window, padded[tuple(slice(a + 10, b + 10) for a, b in zip(start, stop, strict=True))])


def test_with_window_replaces_only_the_window():
    structure = Structure.trim("a", block((2, 2, 2), (5, 5, 5)))
    changed = structure.with_window(np.array([[[False, True]]]), (5, 5, 5))
    expected = block((2, 2, 2), (5, 5, 5))
    expected[5, 5, 5], expected[5, 5, 6] = False, True
    assert np.array_equal(full(changed), expected)


def test_empty_structure():
    empty = Structure.trim("a", np.zeros((3, 3, 3), dtype=bool))
    assert empty.n_voxels == 0
    assert not empty.window((0, 0, 0), (3, 3, 3)).any()


def test_boxes():
    a, b = Structure.trim("a", block((2, 3, 4), (5, 5, 5))), Structure.trim("b", block((1, 4, 4), (2, 8, 4)))
    assert grown_box(a, 2) == ((0, 1, 2), (8, 8, 8))
    assert common_box(a, b) == ((1, 3, 4), (6, 9, 6))


def test_heights_follow_the_affine_of_an_oblique_grid():
    rng = np.random.default_rng(0)
    affine = np.eye(4)
    affine[:3] = rng.normal(size=(3, 4))
    whole = segmentation(affine=affine)
    part = whole.rigid[0]
    heights = np.broadcast_to(whole.heights(part), part.mask.shape)
    index = np.argwhere(part.mask)
    expected = (affine[:3, :3] @ (index + part.corner).T).T[:, 2] + affine[2, 3]
    assert np.allclose(heights[tuple(index.T)], expected)


def test_heights_of_an_upright_grid_vary_along_one_axis_only():
    whole = segmentation()
    assert whole.heights(whole.body).shape == (1, 1, 20)
