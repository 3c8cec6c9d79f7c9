import json
import math
from dataclasses import replace

import pytest

from mixpinn.base.config import build_config
from mixpinn.base.errors import InputError, SolveError
from mixpinn.base.rundir import is_finished
from mixpinn.dataset import PoseState, SimulationStore
from mixpinn.fem import LocalRefinement
from mixpinn.geometry.probe_shapes import linear_probe
from mixpinn.records import TissueMesh
from mixpinn.records.doubts import in_short
from mixpinn.stages.simulation import (
    PAPER_TISSUE_CONFIG,
    SimulationConfig,
    TissueConfig,
    begin_simulations,
    make_scene,
    make_simulations,
)
from pipeline.chain import SIMULATION


@pytest.fixture
def mesh(chain):
    return TissueMesh.load(chain.mesh / "mesh.vtu")


@pytest.fixture
def config():
    return build_config(SimulationConfig, SIMULATION)


@pytest.mark.parametrize("energy", ["stable", "stable-log", "linear"])
def test_constants_in_newtons_per_square_millimetre(energy):
    material = TissueConfig(young=25.4, poisson=0.45, energy=energy).material()
    # λ = E ν / ((1 + ν)(1 − 2 ν)), μ = E / (2 (1 + ν))
    assert material.mu == pytest.approx(25.4e-3 / 2.9)
    assert material.lam == pytest.approx(25.4e-3 * 0.45 / (1.45 * 0.1))


def test_constants_of_the_papers_fields():
    material = PAPER_TISSUE_CONFIG.material()
    assert (material.mu, material.lam) == pytest.approx((8.758621e-3, 84.666667e-3))
    # PROTOCOL of the paper: the bulk modulus of E = 25.4 kPa, ν = 0.45 stands in the place of λ.
    assert math.isclose(material.lam, 25.4e-3 / (3.0 * (1.0 - 2.0 * 0.45)), rel_tol=1e-6)


def test_tissues_by_name(mesh):
    config = SimulationConfig(tissues={mesh.tissue_names[0]: TissueConfig(young=10.0)})
    assert make_scene(mesh, config).materials[0].mu == pytest.approx(10e-3 / 2.9)
    with pytest.raises(InputError, match="'bone'"):
        make_scene(mesh, SimulationConfig(tissues={"bone": TissueConfig()}))


def test_number_of_workers_does_not_identify_a_run(chain, mesh, config):
    store, summary = make_simulations(mesh, replace(config, workers=2), out=chain.simulation)
    assert summary.done == len(store.poses) == 6


def test_cells_refined_under_the_probe_are_a_setting_that_the_store_knows(mesh, config, tmp_path):
    refined = build_config(SimulationConfig, {**SIMULATION, "refinement": {"edge": 12.0}})
    _, store = begin_simulations(mesh, refined, out=tmp_path)
    assert refined.refinement == LocalRefinement(12.0)
    # A scene's has the order of the tool, a rounded one.
    assert store.refinement() == make_scene(mesh, refined).refinement == LocalRefinement(12.0, order=2.25)
    assert make_scene(mesh, config).refinement is None
    with pytest.raises(InputError, match="another config"):
        begin_simulations(mesh, config, out=tmp_path)


def test_a_run_that_was_begun_with_another_order_is_not_continued(mesh, config, tmp_path, monkeypatch):
    refined = build_config(SimulationConfig, {**SIMULATION, "refinement": {"edge": 12.0}})
    begin_simulations(mesh, refined, out=tmp_path)
    begin_simulations(mesh, refined, out=tmp_path)  # the same physics: goes on
    monkeypatch.setattr("mixpinn.fem.local_refinement._ROUNDED_ORDER", 2.0)
    with pytest.raises(InputError, match="begun otherwise"):
        begin_simulations(mesh, refined, out=tmp_path)


def test_nothing_is_written_where_no_position_can_be_probed(mesh, config, tmp_path):
    (tmp_path / "positions.txt").write_text("900 0 0")
    with pytest.raises(InputError, match="probe position"):
        make_simulations(mesh, replace(config, positions=str(tmp_path / "positions.txt")), out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_reason_is_told_where_every_pose_fails_and_kept_where_some_do(mesh, config, tmp_path):
    inside = replace(config, protocol=replace(config.protocol, start="listed", approach=0.0, steps=1))
    back = float(mesh.points[:, 1].max())
    (tmp_path / "positions.txt").write_text(f"0 {back + 4.0} 0\n0 0 10\n")
    (tmp_path / "inside.txt").write_text("0 0 10\n")
    with pytest.raises(InputError, match="outside the body") as caught:
        make_simulations(mesh, replace(inside, positions=str(tmp_path / "inside.txt")), out=tmp_path / "none")
    assert "\n" not in str(caught.value)
    assert not is_finished(tmp_path / "none")
    store, summary = make_simulations(
        mesh, replace(inside, positions=str(tmp_path / "positions.txt")), out=tmp_path / "some",
    )
    assert (summary.done, summary.failed) == (1, 1)
    assert [status.state for status in store.statuses()] == [PoseState.DONE, PoseState.FAILED]
    assert json.loads((tmp_path / "some" / "run.json").read_text())["results"]["failed"] == 1


def test_probe_lies_beside_the_simulations(chain, mesh, config):
    store = SimulationStore.open(chain.simulation / "store", mesh=mesh)
    assert (store.folder / "probe.stl").is_file()
    assert store.scene["probe"] == make_scene(mesh, config).probe.hash()


def test_simulations_of_which_no_step_converged_are_an_error(mesh, config, tmp_path):
    hasty = replace(
        config, protocol=replace(config.protocol, max_positions=1, steps=1),
        solver=replace(config.solver, max_iterations=1),
    )
    with pytest.raises(SolveError, match=r"none of 1 steps converged") as caught:
        make_simulations(mesh, hasty, out=tmp_path / "out")
    assert len(str(caught.value).splitlines()) == 1


def test_a_probe_in_another_unit_is_a_doubt_that_stays_with_the_simulations(mesh, config, tmp_path):
    probe = linear_probe()
    replace(probe, points=probe.points * 0.1).save(tmp_path / "cm.stl")
    doubted = make_scene(mesh, SimulationConfig(probe=str(tmp_path / "cm.stl"))).mesh
    assert doubted.doubts[:-1] == mesh.doubts
    assert "centimetres or inches?" in doubted.doubts[-1]
    assert in_short(doubted.doubts[-1:]) == "shape (probe)"
    assert doubted.hash() == mesh.hash()
    assert make_scene(doubted, SimulationConfig(probe=str(tmp_path / "cm.stl"))).mesh.doubts == doubted.doubts
    assert make_scene(doubted, SimulationConfig()).mesh.doubts == mesh.doubts
    out = tmp_path / "out"
    begin_simulations(mesh, SimulationConfig(probe=str(tmp_path / "cm.stl"), protocol=config.protocol), out=out)
    assert SimulationStore.open(out / "store").mesh().doubts == doubted.doubts
