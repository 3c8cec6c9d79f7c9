import json
from dataclasses import replace

import numpy as np
import pytest

from dataset.dataset_fakes import SHORT, FakeScene, block, fake_simulation, short_store
from mixpinn.dataset import GenerationSummary, inverted_cells, summarise
from mixpinn.records import ProbePath


def turned(mesh, cell, *, pose_steps=(4, 5), height=2.0):
    """A simulation at rest, but for one node of `cell` that goes through the opposite face at some steps.

    det F of the cell is then 1 − `height`, since the node's height over that face falls from 1 to 1 − `height`.
    """
    a, b, c, d = mesh.points[mesh.cells[cell]]
    normal = np.cross(c - b, d - b)
    normal /= np.linalg.norm(normal)
    path = ProbePath(np.zeros((6, 3)), np.tile(np.eye(3), (6, 1, 1)), np.arange(6) - 2.0)
    simulation = fake_simulation(mesh, path, position_index=0, rotation_deg=0.0)
    moved = np.zeros_like(simulation.displacement)
    for count, step in enumerate(pose_steps):
        moved[step, mesh.cells[cell, 0]] = -(height + 0.25 * count) * ((a - b) @ normal) * normal
    return replace(simulation, displacement=moved, min_jacobian=np.where(moved.any(axis=(1, 2)), -1.0, 1.0))


@pytest.fixture
def mesh():
    return block(4)


def test_finds_the_cell_its_depths_and_its_determinant(mesh):
    cell = 17
    found = {entry.cell: entry for entry in inverted_cells(mesh, turned(mesh, cell), "pose_000_000")}
    entry = found[cell]
    assert (entry.pose, entry.steps, entry.step) == ("pose_000_000", 2, 5)
    assert (entry.first_depth, entry.depth) == (2.0, 3.0)
    assert entry.determinant == pytest.approx(1.0 - 2.25, abs=1e-6)
    assert entry.volume == pytest.approx(1000.0 / 6.0)
    # Kuhn's tetrahedron of a unit cube: V = 1/6, A = 1 + √2, R = √3/2.
    assert entry.radius_ratio == pytest.approx(3.0 * (0.5 / (1.0 + np.sqrt(2.0))) / (np.sqrt(3.0) / 2.0))


def test_every_cell_found_has_turned_inside_out_and_no_other(mesh):
    simulation = turned(mesh, 17)
    moved = replace(mesh, points=mesh.points + simulation.displacement[5])
    expected = np.flatnonzero(moved.cell_volumes <= 0.0)
    assert sorted(entry.cell for entry in inverted_cells(mesh, simulation, "p")) == expected.tolist()


def test_unconverged_steps_do_not_count(mesh):
    simulation = turned(mesh, 17)
    failed = replace(simulation, converged=np.arange(6) < 4)
    assert inverted_cells(mesh, failed, "p") == []


def test_names_what_the_nodes_belong_to(mesh):
    rigid = mesh.part[mesh.cells] > 0
    beside = int(np.flatnonzero(rigid.any(axis=1) & ~rigid.all(axis=1))[0])
    found = {entry.cell: entry for entry in inverted_cells(mesh, turned(mesh, beside), "p")}
    assert found[beside].parts == ("L1",)
    assert found[beside].soft_nodes == int((~rigid[beside]).sum())
    apart = int(np.flatnonzero(~rigid.any(axis=1))[0])
    found = {entry.cell: entry for entry in inverted_cells(mesh, turned(mesh, apart), "p")}
    assert (found[apart].parts, found[apart].soft_nodes, found[apart].tissue) == ((), 4, "soft tissue")


def test_summary_lists_them_and_keeps_them_for_the_next_time(tmp_path, mesh):
    store = short_store(tmp_path, FakeScene(mesh), protocol=replace(SHORT, rotations=(0.0,)))
    for pose in store.poses:
        simulation = turned(mesh, 17) if pose.position_index == 1 else turned(mesh, 17, pose_steps=())
        store.save(pose, replace(simulation, position_index=pose.position_index))
    assert summarise(store, cells=False).inverted is None
    summary = summarise(store)
    assert {(entry.pose, entry.steps) for entry in summary.inverted if entry.cell == 17} == {("pose_001_000", 2)}
    assert f"| Inverted cells | {len(summary.inverted)} in 1 poses |" in summary.markdown()
    summary.save(tmp_path / "summary.json")
    assert GenerationSummary.load(tmp_path / "summary.json") == summary
    assert "inverted" not in summary.totals()

    kept = (tmp_path / "inverted.json").read_text()
    (tmp_path / "inverted.json").write_text(kept.replace('"steps": 2', '"steps": 3'))
    assert summarise(store) == summary  # an altered list is made anew
    (tmp_path / "mesh.vtu").unlink()  # not opened again
    assert summarise(store) == summary
    (tmp_path / "inverted.json").write_text("{")
    with pytest.raises(Exception, match="mesh"):
        summarise(store)


def test_summary_of_an_older_run_has_no_list(tmp_path):
    summary = summarise(short_store(tmp_path, FakeScene(block(3))))
    summary.save(tmp_path / "summary.json")
    assert summary.inverted == ()
    values = json.loads((tmp_path / "summary.json").read_text())
    del values["inverted"], values["sha256"]  # neither was written then
    (tmp_path / "summary.json").write_text(json.dumps(values))
    older = GenerationSummary.load(tmp_path / "summary.json")
    assert older.inverted is None
    assert "not looked for" in older.markdown()
