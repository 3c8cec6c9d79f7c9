from dataclasses import replace

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.geometry.probe_shapes import linear_probe, spherical_probe
from mixpinn.records.probe import Probe, check_probe
from mixpinn.records.triangle_edges import edge_uses

PROBE = linear_probe()


def test_probes_as_the_protocol_means_them(shared_data):
    for probe in (PROBE, spherical_probe()):
        assert check_probe(probe) == ()
    told, = check_probe(Probe.load(shared_data / "patient1/paper/probe_collision.stl"))
    assert "up to 44° deep" in told  # its face is bevelled inwards at both ends


@pytest.mark.parametrize(("factor", "extent"), [(0.1, "5.7"), (1 / 25.4, "2.24")])
def test_a_probe_in_centimetres_or_inches_is_warned_of(factor, extent):
    line, = check_probe(replace(PROBE, points=PROBE.points * factor))
    assert f"{extent} mm long: are its lengths centimetres or inches?" in line


def test_a_hole_at_the_tip_and_pieces_are_told():
    low = PROBE.points[PROBE.triangles, 1].min(axis=1)
    line, = check_probe(replace(PROBE, triangles=np.delete(PROBE.triangles, low.argmin(), axis=0)))
    assert "a hole 0.0 mm above its tip" in line
    assert check_probe(replace(PROBE, triangles=np.delete(PROBE.triangles, low.argmax(), axis=0))) == ()
    two = Probe(
        np.vstack([PROBE.points, PROBE.points + np.array([0.0, 60.0, 0.0])]),
        np.vstack([PROBE.triangles, PROBE.triangles + len(PROBE.points)]),
    )
    assert check_probe(two) == ("the probe comes in 2 pieces: each of them presses",)


def test_triangles_of_both_sides_are_turned(tmp_path):
    """Of an OBJ: what writes STL turns them itself."""
    turned = PROBE.triangles.copy()
    turned[::3] = turned[::3, ::-1]
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in PROBE.points.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (turned + 1).tolist()]
    (tmp_path / "probe.obj").write_text("\n".join(lines))
    found = Probe.load(tmp_path / "probe.obj")
    _, faces, along = edge_uses(found.triangles)
    assert (faces == 2).all()
    assert (along == 1).all()
    assert len(found.triangles) == len(turned)


@pytest.mark.parametrize(("points", "says"), [
    (PROBE.points * 1e-3, "metres"), (PROBE.points * 1e3, "micrometres"), (PROBE.points * [1, -1, 1], "on its head"),
    (PROBE.points + np.array([120.0, 35.0, -60.0]), "away from it"),
    (PROBE.points + np.array([40.0, 0.0, 0.0]), "away from it"),
    (np.column_stack([PROBE.points[:, 0], -PROBE.points[:, 2], PROBE.points[:, 1]]), "away from it"),
    (PROBE.points + np.array([0.0, 8.0, 0.0]), "away from it"),
], ids=["metres", "micrometres", "head", "beside", "shifted", "z up", "above"])
def test_what_is_no_probe(points, says):
    with pytest.raises(InputError, match=says):
        check_probe(replace(PROBE, points=np.asarray(points)))
