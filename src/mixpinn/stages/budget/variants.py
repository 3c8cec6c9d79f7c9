"""The scenes whose full solves an error budget compares: the bundle's own, and each with one thing changed."""

from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial

import numpy as np

from mixpinn.anatomy.mixture import mixed_parts
from mixpinn.base.errors import InputError
from mixpinn.base.sensible import require_settings
from mixpinn.fem import LocalRefinement, Material, Scene, StableNeoHookean
from mixpinn.fem.contact.model import ContactConfig
from mixpinn.fem.material.mixed import mean_material
from mixpinn.fem.scene_record import refinement_of
from mixpinn.fem.solve.quasi_static import SolverConfig
from mixpinn.geometry.probe_pose import PATH_STEP
from mixpinn.mesh import FixedRegion, fixed_nodes, refine
from mixpinn.physics.restraints import FREE
from mixpinn.records import TissueMesh
from mixpinn.records.error_budget import BudgetKind
from mixpinn.serving import HybridPredictor
from mixpinn.stages.budget.restraints import HELD, JOINTS, SUPPORT, restraint_variants, restraints_present
from mixpinn.stages.budget.variant import Variant


class Finer(StrEnum):
    """What the discretisation is held against, on the same facets."""

    QUADRATIC = "quadratic"
    """Ten-node cells on the same mesh; for a bundle of linear cells."""
    HALVED = "halved"
    """The same cells with every edge halved: eight times as many."""
    REFINED = "refined"
    """Ten-node cells, refined under the probe to two lengths and extrapolated (`mixpinn.fem.local_refinement`)."""


@dataclass(frozen=True)
class BudgetConfig:
    """What is compared.

    Attributes:
        poses: presses over the rigid parts.
        depth: of each, beyond first touch [mm].
        finer: what the discretisation is held against.
        stiffness_factor: of the penalty of contact, for its error.
        gap_share: the gap at which contact acts is changed to this share of it, or as much wider, for its error.
        modulus: by what share the moduli of the tissues but the first are changed; of a single tissue, its own.
        poisson: by how much Poisson's ratio of every tissue is changed.
        friction: by how much Coulomb's coefficient is changed.
        fixed: by how much the depth of the region that is held in place is changed [mm].
        sensitivity: also find what is not known of the patient decides; else errors alone.
        threads: of the solver.
    """

    poses: int = 3
    depth: float = 10.0
    finer: Finer = Finer.REFINED
    stiffness_factor: float = 4.0
    gap_share: float = 0.75
    modulus: float = 0.2
    poisson: float = 0.03
    friction: float = 0.5
    fixed: float = 10.0
    sensitivity: bool = True
    threads: int = 1

    def __post_init__(self) -> None:
        require_settings(self, "budget", {
            "poses": (1 <= self.poses <= 50, "1 to 50 poses"), "depth": (0.0 < self.depth <= 40.0, "0 to 40 mm"),
            "stiffness_factor": (1.0 < self.stiffness_factor <= 100.0, "more than 1"),
            "gap_share": (0.0 < self.gap_share < 1.0, "between 0 and 1"),
            "modulus": (0.0 < self.modulus < 1.0, "between 0 and 1"),
            "poisson": (0.0 < self.poisson < 0.2, "between 0 and 0.2"),
            "friction": (self.friction > 0.0, "more than 0"), "fixed": (self.fixed > 0.0, "more than 0 mm"),
        })


PENALTY, GAP, CELLS, FACETS = "contact penalty", "contact gap", "discretisation", "facets"
MODULUS, POISSON, FRICTION, FIXED = "tissue modulus", "Poisson's ratio", "friction", "fixed region"


def base_scene(predictor: HybridPredictor, config: BudgetConfig) -> Scene:
    """The full solver's scene that the bundle stands for: its mesh, tissues, restraints, probe, gap and friction."""
    model, pose = predictor.model, predictor.pose
    assert pose is not None
    equilibrium = model.newton.equilibrium
    materials = tuple(
        StableNeoHookean(float(mu), float(lam)) for mu, lam in zip(equilibrium.mu, equilibrium.lam, strict=True)
    )
    restraints = model.prior.restraints
    return Scene(
        predictor.mesh, pose.probes[0].probe, materials,
        ContactConfig(gap=pose.contact.config.gap, friction=pose.contact.config.friction),
        SolverConfig(threads=config.threads), joints=restraints.joints, foundations=restraints.foundations,
        membrane=restraints.membrane,
        refinement=None if model.refinement is None else refinement_of(model.refinement),
    )


def variants(base: Scene, config: BudgetConfig, *, facets: TissueMesh | None = None) -> list[Variant]:
    """What the budget solves besides the bundle's own scene, the cheap ones first.

    Args:
        base: of the bundle.
        config: what is changed by how much.
        facets: a mesh of the same anatomy whose surfaces are finer.

    Raises:
        InputError: `facets` is a mesh of other parts or tissues.
    """
    errors = _contact_errors(base, config)
    unknown = [
        *_frictions(base, config), *_tissues(base, config), *_fixed_regions(base, config), *restraint_variants(base),
    ] if config.sensitivity else []
    finer = [_finer_cells(base, config), *([] if facets is None else [_finer_facets(base, facets)])]
    return [*errors, *unknown, *finer]


def _contact_errors(base: Scene, config: BudgetConfig) -> list[Variant]:
    contact, factor = base.contact, config.stiffness_factor
    stiffer = replace(contact, stiffness=factor * contact.stiffness)
    # With the gap of a path's step or less the first step would end under the skin: then a wider one.
    share = config.gap_share if config.gap_share * contact.gap > 1.2 * PATH_STEP else 2.0 - config.gap_share
    other = replace(contact, gap=share * contact.gap)
    return [
        # What gives way is proportional to 1/k: from k to rigid it is κ/(κ − 1) of that from k to κ k.
        Variant(
            PENALTY, BudgetKind.ERROR, f"{stiffer.stiffness:g} N/mm, extrapolated to rigid",
            partial(replace, base, contact=stiffer), scale=factor / (factor - 1.0),
        ),
        Variant(
            GAP, BudgetKind.ERROR, f"{other.gap:g} mm, extrapolated to none", partial(replace, base, contact=other),
            scale=1.0 / abs(1.0 - share),
        ),
    ]


def _frictions(base: Scene, config: BudgetConfig) -> list[Variant]:
    contact = base.contact
    return [
        Variant(
            FRICTION, BudgetKind.SENSITIVITY, f"{friction:g}",
            partial(replace, base, contact=replace(contact, friction=friction)),
        ) for friction in (max(0.0, contact.friction - config.friction), contact.friction + config.friction)
    ]


def _tissues(base: Scene, config: BudgetConfig) -> list[Variant]:
    """Other Poisson's ratios; other moduli where they change more than the size of all forces."""
    tissues, found = tuple(_lame(material) for material in base.materials), []
    for sign in (-1.0, 1.0):
        soft = tuple(_with_poisson(material, sign * config.poisson) for material in tissues)
        found.append(Variant(
            POISSON, BudgetKind.SENSITIVITY, f"{_moduli(soft[0])[1]:.3f}", partial(replace, base, materials=soft),
        ))
    if len(tissues) == 1 and base.restraints == FREE:
        return found
    first = 1 if len(tissues) > 1 else 0
    for factor in (1.0 - config.modulus, 1.0 + config.modulus):
        scaled = tuple(
            material if index < first else StableNeoHookean(factor * material.mu, factor * material.lam)
            for index, material in enumerate(tissues)
        )
        found.append(Variant(
            MODULUS, BudgetKind.SENSITIVITY, f"× {factor:g}", partial(replace, base, materials=scaled),
        ))
    return found


def _fixed_regions(base: Scene, config: BudgetConfig) -> list[Variant]:
    meshes = [(change, _with_fixed(base.mesh, change)) for change in (-config.fixed, config.fixed)]
    return [
        Variant(FIXED, BudgetKind.SENSITIVITY, f"{change:+g} mm", partial(replace, base, mesh=mesh))
        for change, mesh in meshes if mesh is not None
    ]


def _finer_cells(base: Scene, config: BudgetConfig) -> Variant:
    scene = partial(_with_finer_cells, base, config.finer)
    if config.finer is Finer.REFINED:
        return Variant(CELLS, BudgetKind.ERROR, f"quadratic, {_refinement(base)} under the probe", scene)
    if config.finer is Finer.QUADRATIC:
        return Variant(
            CELLS, BudgetKind.ERROR, config.finer.value, scene,
            note="quadratic cells on the same mesh are not converged either",
        )
    # Errors fall with the edge length under the probe: halving it tells half of what is missing.
    return Variant(CELLS, BudgetKind.ERROR, f"{config.finer.value}, extrapolated", scene, scale=2.0)


def _refinement(base: Scene) -> LocalRefinement:
    """What a scene's cells are held against; finer by √2 than its own where it has one."""
    own = base.refinement
    return LocalRefinement() if own is None else replace(own.scaled(np.sqrt(0.5)), extrapolated=True)


def _with_finer_cells(base: Scene, finer: Finer) -> Scene:
    if finer is Finer.REFINED:
        return replace(base, mesh=base.mesh.with_order(2), refinement=_refinement(base))
    return replace(base, mesh=_finer(base.mesh, finer))


def _finer_facets(base: Scene, facets: TissueMesh) -> Variant:
    known = dict(zip(base.mesh.tissue_names, base.materials, strict=True))
    # What shares of two tissues cells hold depends on the mesh: of each mixture only the tissues must be known.
    mixed = [[(share, known.get(part)) for part, share in mixed_parts(name)] for name in facets.tissue_names]
    if facets.rigid_names != base.mesh.rigid_names or any(law is None for parts in mixed for _, law in parts):
        raise InputError(
            "facets", expected="a mesh of the same anatomy: rigid parts " + ", ".join(base.mesh.rigid_names),
            got=", ".join(facets.rigid_names) or "none", fix="mesh the same label maps with the same parts and tissues",
        )
    mesh = facets.with_order(base.mesh.order)
    materials = tuple(mean_material([(share, law) for share, law in parts if law is not None]) for parts in mixed)
    return Variant(
        FACETS, BudgetKind.ERROR, f"{facets.n_points} vertices", partial(replace, base, mesh=mesh, materials=materials),
        same_vertices=False, note="the cells differ too",
    )


def present(source: str, base: Scene) -> str:
    """What the bundle has of a source, in words."""
    if source in (JOINTS, SUPPORT, HELD):
        return restraints_present(source, base)
    return {
        PENALTY: f"{base.contact.stiffness:g} N/mm", GAP: f"{base.contact.gap:g} mm",
        FRICTION: f"{base.contact.friction:g}", POISSON: f"{_moduli(_lame(base.materials[0]))[1]:.3f}",
        CELLS: _cells(base), FACETS: f"{base.mesh.n_points} vertices",
    }.get(source, "as it is")


def _cells(base: Scene) -> str:
    kind = "linear" if base.mesh.order == 1 else "quadratic"
    return kind if base.refinement is None else f"{kind}, {base.refinement} under the probe"


def _finer(mesh: TissueMesh, finer: Finer) -> TissueMesh:
    if finer is Finer.QUADRATIC:
        return mesh.with_order(2)
    return refine(mesh.with_order(1)).with_order(mesh.order)


def _moduli(material: StableNeoHookean) -> tuple[float, float]:
    """Young's modulus [MPa] and Poisson's ratio: E = μ (3λ + 2μ)/(λ + μ), ν = λ/(2(λ + μ))."""
    mu, lam = material.mu, material.lam
    return mu * (3.0 * lam + 2.0 * mu) / (lam + mu), lam / (2.0 * (lam + mu))


def _with_poisson(material: StableNeoHookean, change: float) -> StableNeoHookean:
    young, poisson = _moduli(material)
    return StableNeoHookean.from_young(young, float(np.clip(poisson + change, 0.0, 0.495)))


def _lame(material: Material) -> StableNeoHookean:
    assert isinstance(material, StableNeoHookean), "bundles have no other material"
    return material


def _with_fixed(mesh: TissueMesh, change: float) -> TissueMesh | None:
    """The mesh whose fixed region reaches `change` [mm] farther back; None where nothing or nobody would be held."""
    skin = mesh.fixed & (mesh.part == 0)
    if not skin.any():
        return None
    region = FixedRegion.of(mesh.points)
    if not np.array_equal(fixed_nodes(mesh, region=region), skin):  # held otherwise: the region of those that are
        z = mesh.points[skin, 2]
        region = FixedRegion(float(mesh.points[skin, 1].max()) + 1e-6, float(z.min()) - 1e-6, float(z.max()) + 1e-6)
    held = fixed_nodes(mesh, region=replace(region, behind=region.behind + change))
    if np.count_nonzero(held) < 3:
        return None
    return replace(mesh, fixed=held | (mesh.fixed & ~skin))
