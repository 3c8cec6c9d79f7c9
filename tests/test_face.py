"""The public face on a tiny phantom: the typical jobs with ``import mixpinn as mx`` alone."""

import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import nibabel as nib
import numpy as np
import pytest
import pyvista as pv

import mixpinn as mx
from mixpinn.anatomy.phantom import TINY_PHANTOM, phantom_segmentation


@pytest.fixture(scope="module")
def segmentations(tmp_path_factory):
    """A folder with one NIfTI a structure: the tiny phantom with three vertebrae."""
    folder = tmp_path_factory.mktemp("segmentations")
    phantom = phantom_segmentation(replace(TINY_PHANTOM, vertebrae=3))
    for structure in (phantom.body, *phantom.rigid):
        mask = structure.window((0, 0, 0), phantom.shape).astype(np.uint8)
        nib.save(nib.Nifti1Image(mask, phantom.affine), folder / f"{structure.name}.nii.gz")
    return folder


@pytest.fixture(scope="module")
def work(segmentations, tmp_path_factory):
    """What the typical jobs make before anything is answered, in a folder of its own."""
    folder = tmp_path_factory.mktemp("face")
    labels = mx.load_anatomy(segmentations, repair=True)
    mesh = mx.make_mesh(labels, size=4.0)
    scene = mx.Scene(mesh)
    protocol = replace(mx.protocols.SMALL, max_positions=10, steps=5)
    store = mx.simulate(scene, protocol, out=folder / "simulation", workers=1)
    model = mx.fit("hybrid", store, out=folder / "hybrid")
    return SimpleNamespace(folder=folder, scene=scene, store=store, model=model)


@pytest.fixture(scope="module")
def tip(work):
    """Where a probe ends that is pressed 3.5 mm deep at the position nearest the middle, world [mm]."""
    touched = np.array([pose.position for pose in work.store.poses])
    middle = np.linalg.norm(touched - touched.mean(axis=0), axis=1).argmin()
    return touched[middle] - np.array([0.0, 3.5, 0.0])


@pytest.fixture(scope="module")
def truth(work, tip):
    """One full solve."""
    return mx.solve_pose(work.scene, tip=tip, rotation_deg=0.0)


def test_the_typical_jobs_end_in_an_answer_that_is_saved(work, tip, truth):
    predictor = mx.load(work.folder / "hybrid")
    answer = predictor.press(tip=tip, rotation_deg=0.0)
    for found in (truth, answer):
        assert isinstance(found, mx.Answer)
        assert found.displacement.shape == (work.scene.mesh.n_points, 3)
        assert found.force.shape == (3,)
        assert found.force[1] > 0.0  # the tissue pushes the probe back, against its −y
        assert found.motions["vertebrae_L3"].rotation.shape == (3, 3)
        assert found.trust.converged
    answer.save(work.folder / "deformed.vtu")
    grid = pv.read(work.folder / "deformed.vtu")
    np.testing.assert_allclose(grid.points, predictor.mesh.points + answer.displacement, atol=1e-5)


def test_predictor_and_full_solve_agree_within_the_stated_bound(work, tip, truth):
    answer = work.model.press(tip=tip, rotation_deg=0.0)
    error = np.linalg.norm(answer.displacement - truth.displacement, axis=1).mean()
    # A bundle that states no bound for poses must still come close: within a tenth of the motion.
    motion = np.linalg.norm(truth.displacement, axis=1).mean()
    assert error < (0.1 * motion if answer.trust.bound is None else answer.trust.bound)


def test_histories_continue_both_kinds_of_answer(work, tip, truth):
    press = work.model.press
    first = press(tip=tip)
    deeper = tip - np.array([0.0, 0.5, 0.0])
    continued = press(tip=deeper, history=first.history)
    assert continued.force[1] > first.force[1] > 0.0
    solved = mx.solve_pose(work.scene, tip=deeper, rotation_deg=0.0, history=truth.history)
    assert solved.force[1] > truth.force[1]
    with pytest.raises(mx.InputError, match="history"):
        press(tip=tip, history=truth.history)
    with pytest.raises(mx.InputError, match="history"):
        mx.solve_pose(work.scene, tip=tip, history=first.history)


def test_networks_are_fitted_by_the_same_call(work):
    settings = mx.ModelsConfig(names=("mixpinn",), width="tiny", train=mx.TrainConfig(max_epochs=1, threads=1))
    network = mx.fit("mixpinn", work.store, out=work.folder / "network", settings=settings)
    nodes = np.flatnonzero((network.mesh.part == 0) & ~network.mesh.fixed)[:3]
    assert network.predict_at(nodes, np.tile([0.0, -1.0, 0.0], (3, 1))).source is mx.Source.NETWORK
    with pytest.raises(mx.InputError, match="hybrid"):
        mx.fit("no such model", work.store, out=work.folder / "nothing")


def test_importing_the_package_brings_no_library():
    script = "import sys, mixpinn; print(sorted({name.partition('.')[0] for name in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    for heavy in ("numpy", "scipy", "numba", "torch", "pyvista", "rich", "zarr", "matplotlib"):
        assert f"'{heavy}'" not in done.stdout


def test_every_public_name_is_there_and_unknown_ones_are_refused():
    for name in mx.__all__:
        assert getattr(mx, name) is not None
    assert set(mx.__all__) <= set(dir(mx))
    with pytest.raises(AttributeError, match="no_such_name"):
        mx.no_such_name  # noqa: B018
