import json

import numpy as np
import pytest

from mixpinn.dataset import InvertedCell
from mixpinn.fem import ElasticSystem, LinearElastic
from validation import __main__ as command
from validation.blocks import block, surface_nodes
from validation.closed_form import uniaxial_closed_form
from validation.contact.hertz import exact_force, exact_radius, graded
from validation.contact.probe_side import nearest_places
from validation.linear_elasticity import newton_orders
from validation.material import MATERIALS, difference_error
from validation.newton import equilibrium
from validation.page import section_text, split_page, stored_results, write_page
from validation.protocol import inverted_rows, inverted_text
from validation.result import Result, Section


def test_block_fills_its_box_with_positive_cells():
    mesh = block((3, 4, 2), size=(3.0, 2.0, 1.0), shake=0.2, rng=np.random.default_rng(0))
    assert mesh.cell_volumes.min() > 0.0
    assert mesh.cell_volumes.sum() == pytest.approx(6.0)
    # A conforming mesh has two triangles for each of the surface's rectangles.
    assert len(mesh.skin_faces) == 2 * 2 * (3 * 4 + 4 * 2 + 3 * 2)


def test_newton_stretches_a_bar_as_hooke_says():
    mesh = block((2, 2, 2))
    system = ElasticSystem(mesh, [LinearElastic.from_young(2.0, 0.25)])
    held = np.repeat(surface_nodes(mesh), 3)
    strain = np.diag([0.01, -0.0025, -0.0025])
    shift = np.where(held, (mesh.points @ strain).ravel(), 0.0)
    found = equilibrium(system, system.rest_state(), held=held, shift=shift)
    assert found.converged
    right = mesh.points[:, 0] > 1.0 - 1e-9
    assert system.gradient(found.state)[right, 0].sum() == pytest.approx(0.02)  # E ε over a face of 1 mm²


def test_closed_forms():
    assert uniaxial_closed_form(1.0) == pytest.approx(0.0, abs=1e-12)
    # Young's modulus of μ = 1, λ = 4: μ (3 λ + 2 μ)/(λ + μ) = 14/5
    assert (uniaxial_closed_form(1.0 + 1e-6) - uniaxial_closed_form(1.0 - 1e-6)) / 2e-6 == pytest.approx(2.8, rel=1e-6)
    force, radius = exact_force(), exact_radius()
    assert force[1] / force[0] == pytest.approx((radius[1] / radius[0]) ** 3)


def test_graded_coordinates_ascend_to_the_end():
    places = graded(0.5, 2.0, 40.0)
    assert places[[0, -1]] == pytest.approx([0.0, 40.0])
    assert np.diff(places)[:4] == pytest.approx(0.5)
    assert np.diff(places).min() >= 0.5 - 1e-12


def test_order_of_newton_is_read_off_the_residuals():
    assert newton_orders([1e-1, 1e-2, 1e-4, 1e-8]) == pytest.approx([2.0, 2.0])


def test_a_wrong_tangent_shows():
    rng = np.random.default_rng(0)
    deformation = np.eye(3) + 0.1 * rng.normal(size=(5, 3, 3))
    right = MATERIALS["Stable Neo-Hookean"]

    class Wrong(type(right)):  # type: ignore[misc]
        def hessian(self, deformation):
            return 1.01 * super().hessian(deformation)

    directions = rng.normal(size=(5, 3, 3))
    assert difference_error(right, deformation, directions, 1e-4) < 1e-6
    assert difference_error(Wrong(right.mu, right.lam), deformation, directions, 1e-4) > 1e-3


def test_results_and_page(tmp_path):
    missed = Result.at_most("a", 2.0, 1.0)
    assert not missed.met
    assert Result.within("b", 1.0, 0.5, 1.5).met
    assert Result("c", float("nan"), "≤ 1", False).json()["value"] is None
    page = tmp_path / "page.md"
    first, second = Section("First", "text", (missed,)), Section("Second", "more", (), table=(("x",), ("1",)))
    write_page(page, [second], order=["First", "Second"])
    write_page(page, [first], order=["First", "Second"])
    text = page.read_text()
    assert list(split_page(text)) == ["First", "Second"]
    assert "| a | 2 | ≤ 1 | no |" in text
    assert section_text(second, "page") in text


def test_the_command_ends_with_json(tmp_path, capsys):
    command.main(["--only", "closed_form", "--page", str(tmp_path / "validation.md"), "--cache", str(tmp_path)])
    rows = json.loads(capsys.readouterr().out.strip().splitlines()[-1])
    assert {"check", "value", "bar", "met"} == set(rows[0])
    assert all(row["met"] for row in rows)
    assert (tmp_path / "validation" / "closed_form.png").is_file()


def test_long_checks_are_read_back_from_the_page(tmp_path):
    page, title = tmp_path / "page.md", "Long"
    rows = (
        Result.at_most("largest |T| / (μ N)", 0.25, 1.0), Result("poses", 74.0, "= 74", True),
        Result("not made", float("nan"), "≤ 1", False),
    )
    assert stored_results(page, title) == ()
    write_page(page, [Section(title, "text | with a bar", rows, table=(("check", "x"), ("a", "1")))], order=[title])
    found = stored_results(page, title)
    assert found[:2] == rows[:2]
    assert (found[2].check, found[2].met, np.isnan(found[2].value)) == ("not made", False, True)
    assert len(found) == 3
    assert stored_results(page, "Other") == ()


def test_a_command_without_long_runs_keeps_their_figures(tmp_path, capsys, monkeypatch):
    page = tmp_path / "validation.md"
    kept = Result("SOFA imposed, poses", 74.0, "= 74", True)
    write_page(page, [Section(command.TITLES["sofa_imposed"], "text", (kept,))], order=list(command.TITLES.values()))
    quick = Result("quick", 1.0, "= 1", True)

    def made(options):
        return {name: lambda name=name: Section(command.TITLES[name], "", (quick,)) for name in command.TITLES}

    monkeypatch.setattr(command, "checks", made)
    command.main(["--page", str(page), "--cache", str(tmp_path)])
    rows = json.loads(capsys.readouterr().out.strip().splitlines()[-1])
    assert kept.json() in rows
    assert rows.count(quick.json()) == len(command.TITLES) - len(command.LONG) - 2  # nor the two protocols
    assert {"check": "The paper's protocol", "value": None, "bar": "made", "met": False} in rows


def test_nearest_places_are_no_farther_than_any_other_place():
    rng = np.random.default_rng(0)
    points, corners = rng.normal(size=(200, 3)), rng.normal(size=(200, 3, 3))
    found = np.linalg.norm(nearest_places(points, corners) - points, axis=1)
    weights = rng.dirichlet([0.5, 0.5, 0.5], size=(200, 4000))
    sampled = np.linalg.norm(weights @ corners - points[:, None], axis=2).min(axis=1)
    assert (found <= sampled + 1e-12).all()
    assert (sampled - found).max() < 0.2


def test_inverted_cells_in_words():
    def cell(pose, number, determinant, parts):
        return InvertedCell(pose, number, 1, 5, 3.0, 2.0, determinant, parts, 1, "fat", 2.0, 0.1)

    entries = (
        cell("pose_000_000", 7, -0.2, ("L1", "L2")), cell("pose_001_000", 7, -0.5, ("L1", "L2")),
        cell("pose_001_000", 9, -0.1, ()),
    )
    text, rows = inverted_text(entries), inverted_rows(entries)
    assert "2 cells are inverted in 2 poses" in text
    assert "1 between two rigid parts, 1 in soft tissue" in text
    assert "det F = -0.5, cell 7 in pose_001_000 at 3 mm" in text
    assert [row[0] for row in rows[1:]] == ["7", "9"]
    assert inverted_text(()).startswith("No cell")
