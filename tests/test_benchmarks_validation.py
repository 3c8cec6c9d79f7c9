import json

import numpy as np
import pytest

from benchmarks.validation import __main__ as command
from benchmarks.validation.blocks import block, surface_nodes
from benchmarks.validation.closed_form import uniaxial_closed_form
from benchmarks.validation.hertz import exact_force, exact_radius, graded
from benchmarks.validation.linear_elasticity import newton_orders
from benchmarks.validation.material import MATERIALS, difference_error
from benchmarks.validation.newton import equilibrium
from benchmarks.validation.page import section_text, split_page, write_page
from benchmarks.validation.result import Result, Section
from mixpinn.fem import ElasticSystem, LinearElastic


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
