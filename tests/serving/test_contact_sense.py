from dataclasses import replace

import numpy as np
import pytest

from mesh.shapes import box_mesh
from mixpinn.base.errors import InputError
from mixpinn.serving.contact_sense import check_contacts

MESH = box_mesh(cavity=np.s_[1:3, 1:3, 1:2], spacing=40.0)
MESH = replace(MESH, fixed=MESH.points[:, 1] < -70.0)
BACK = np.flatnonzero(MESH.points[:, 1] > 70.0)[:5]
PRESSED = np.tile([0.0, -3.0, 0.1], (5, 1))


def test_what_a_probe_does_passes():
    check_contacts(MESH, BACK, PRESSED, what="contacts.csv")
    check_contacts(MESH, BACK, 0.0 * PRESSED, what="contacts.csv")
    check_contacts(MESH, BACK, np.tile([0.0, -30.0, 0.0], (5, 1)), what="contacts.csv")


@pytest.mark.parametrize(("nodes", "displacements", "says"), [
    (np.flatnonzero(MESH.part == 1)[:5], PRESSED, "rigid part"),
    (np.flatnonzero(MESH.fixed)[:5], PRESSED, "nodes fixed"),
    (BACK, MESH.points[BACK] + PRESSED, "their places"), (BACK, PRESSED * 1e-3, "metres"),
])
def test_what_no_probe_does(nodes, displacements, says):
    with pytest.raises(InputError, match=says):
        check_contacts(MESH, nodes, displacements, what="contacts.csv")


def test_other_shapes_are_left_to_the_predictor():
    for nodes, displacements in ((BACK, PRESSED[:2]), (BACK + 9999, PRESSED), (BACK, PRESSED * np.nan)):
        check_contacts(MESH, nodes, displacements, what="contacts.csv")
