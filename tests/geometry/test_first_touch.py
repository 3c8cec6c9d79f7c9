"""First touch of flat and pointed probes, and of those that SOFA recorded."""

import numpy as np
import pytest

from dataset.dataset_fakes import block, plate
from mixpinn.base.arrays import FloatArray
from mixpinn.base.errors import InputError
from mixpinn.geometry.first_touch import first_touch
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.mesh import import_vtu
from mixpinn.records import Probe, TissueMesh


def touch(mesh: TissueMesh, probe: Probe, position, *, rotation_deg: float = 0.0, gap: float = 2.0) -> FloatArray:
    """First touch of `probe`, turned about y, with the skin of `mesh`."""
    return first_touch(
        np.asarray(position, dtype=np.float64), rotation_from_vector(np.array([0.0, np.deg2rad(rotation_deg), 0.0])),
        points=mesh.points, triangles=mesh.skin_faces, probe=probe, gap=gap,
    )


@pytest.mark.parametrize("gap", [0.5, 2.0])
def test_flat_probe_touches_flat_skin_at_the_gap(gap):
    found = touch(block(), plate(), [1.0, 40.0, 2.0], rotation_deg=30.0, gap=gap)
    np.testing.assert_allclose(found, [1.0, gap, 2.0], atol=2e-3)


def test_first_touch_is_of_the_probe_and_not_of_its_tip():
    # A probe with one corner 3 mm ahead of the tip stops 3 mm earlier.
    flat = plate()
    points = flat.points.copy()
    points[0, 1] = -3.0
    found = touch(block(), Probe(points, flat.triangles), [0.0, 0.0, 0.0])
    assert found[1] == pytest.approx(5.0, abs=2e-3)


def test_probe_larger_than_the_body_finds_it_between_its_own_vertices():
    found = touch(block(2), plate(200.0), [0.0, 0.0, 0.0])
    assert found[1] == pytest.approx(2.0, abs=2e-3)


def test_touch_beside_the_body_is_refused():
    with pytest.raises(InputError, match="in the probe's way"):
        touch(block(), plate(), [500.0, 0.0, 0.0])


def test_first_touch_foretells_the_first_loaded_step_of_recorded_poses(shared_data):
    """SOFA's probe moves by 1 mm a step: its first step with force lies 0 to 1 mm beyond first touch."""
    folder = shared_data / "patient1/paper"
    mesh = import_vtu(folder / "body.vtu", fixed=folder / "fixed.txt")
    probe = Probe.load(folder / "probe_collision.stl")
    for name in ("pose_000_000", "pose_035_090", "pose_067_045", "pose_117_135", "pose_092_000"):
        with np.load(shared_data / f"sofa/{name}.npz") as recording:
            loaded = np.flatnonzero(np.abs(recording["contact_forces_mN"]).sum(axis=1) > 0.0)[0]
            step = np.searchsorted(recording["contact_offsets"], loaded, side="right") - 1
            tips, rotation = recording["contact_probe_position"].astype(float), float(recording["rotation_deg"])
        found = touch(mesh, probe, tips[0], rotation_deg=rotation)
        assert 0.0 <= found[1] - tips[step, 1] <= 1.0
