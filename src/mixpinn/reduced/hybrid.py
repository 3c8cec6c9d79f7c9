"""HybridModel: the elastic prior and a learned correction in few modes; rigid parts move exactly rigidly.

The prior answers a contact displacement with the linear response q⁰ of the body. What it misses is of second order and
lies in few modes Ψ of the reduced unknowns, so that the prediction is

    q = q⁰ + Ψᵀ z,    z = G φ,    φ = [ν, a, a ⊗ a].

ν are the coefficients of one Newton step of the true equilibrium from q⁰ (`ModalNewton`), which knows the material, the
geometry and the contact nodes of this very sample; a are the leading principal coordinates of q⁰; and G is a ridge
regression on simulations. The twists in q move the rigid parts by finite rotations: their edges cannot change length.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray
from mixpinn.base.errors import InputError
from mixpinn.base.files import write_json
from mixpinn.base.manifest import Artefact
from mixpinn.base.tensor_file import read_arrays, write_arrays
from mixpinn.base.validated import ArraySpec, load_record
from mixpinn.records import MESH_FILE, TissueMesh
from mixpinn.records.answer import discretisation_of
from mixpinn.reduced.compliance.rows import Rows
from mixpinn.reduced.equilibrium import Equilibrium
from mixpinn.reduced.error_estimate import ErrorEstimate, Signs
from mixpinn.reduced.modal_newton import ModalNewton
from mixpinn.reduced.near_answer import NearAnswer
from mixpinn.reduced.near_cells import NearCells
from mixpinn.reduced.prior import PRIOR, ContactSystem, ElasticPrior
from mixpinn.reduced.quadratic_features import quadratic_features

HYBRID_FILE, _TENSORS, PRIOR_FOLDER = "hybrid.json", "hybrid.safetensors", "prior"
BUNDLE = Artefact(
    "hybrid bundle", 1, "fit it again (mixpinn train --model hybrid, mixpinn onboard) or copy its folder again",
)
POSE_FILE = "pose.safetensors"
"""What a bundle that takes poses holds besides; see `mixpinn.press.files`."""
_PRIOR_MANIFEST = f"{PRIOR_FOLDER}/{PRIOR.manifest}"
FILES = (HYBRID_FILE, _TENSORS, _PRIOR_MANIFEST, MESH_FILE, POSE_FILE)
"""All that a bundle's manifest lists; the files of the prior are listed by its own."""

_FORMAT = 1
_ARRAYS = {
    "modes": ArraySpec("number", ("modes", "unknowns")), "duals": ArraySpec("number", ("modes", "unknowns")),
    "coupling": ArraySpec("number", ("modes", "rows")), "readers": ArraySpec("number", ("coordinates", "rows")),
    "gain": ArraySpec("number", ("features", "modes")),
}

_SCALE = ArraySpec("number", ("modes",))
"""Of modes and duals in 16-bit integers."""


@dataclass(frozen=True)
class _About:
    """What ``hybrid.json`` holds."""

    format: Literal[1]
    mesh_hash: str
    mu: tuple[float, ...]
    lam: tuple[float, ...]
    name: str
    about: dict[str, Any]
    error: dict[str, Any] | None
    discretisation: str = ""
    newton_length: float = 0.0
    reach: float | None = None
    near: float | None = None


@dataclass(frozen=True, eq=False)
class HybridState:
    """A prediction before it is spread over the mesh.

    Attributes:
        contact: the contact nodes that are held.
        response: q⁰ [mm, rad], shape (D,).
        force: of the prior on the contact nodes [N], shape (3 l,).
        unknowns: q, with the contact nodes where they were put [mm, rad], shape (D,).
        step: ν, shape (m,).
        correction: z, shape (m,).
        coordinates: a, shape (k,).
    """

    contact: ContactSystem
    response: Float32Array
    force: FloatArray
    unknowns: Float32Array
    step: Float32Array
    correction: Float32Array
    coordinates: Float32Array


@dataclass(frozen=True, eq=False)
class HybridModel:
    """Contact displacement in, displacement of every node out.

    Attributes:
        newton: modes, duals and the two physical models behind them.
        readers: a = readers_L f for forces f on the contact nodes, shape (k, 3 c).
        gain: G, shape (m + k + k (k + 1) / 2, m); rows of features that were not fitted are zero.
        error: what error to expect, where the model was calibrated.
        about: how it was fitted, plain values.
        name: for tables.
        newton_length: the part of the Newton step that the correction is at least, ℓ.
        reach: what the regression may add to ℓ ν, in lengths of ν: |z − ℓ ν| ≤ reach |ν|. A regression on few samples
            can be far off between them; what it adds is cut back to this length, and physics remains.
    """

    newton: ModalNewton
    readers: Float32Array
    gain: Float32Array
    error: ErrorEstimate | None = None
    about: dict[str, Any] = field(default_factory=dict)
    name: str = "Hybrid"
    newton_length: float = 0.0
    reach: float = np.inf

    @property
    def mesh(self) -> TissueMesh:
        """The mesh."""
        return self.newton.prior.mesh

    @property
    def prior(self) -> ElasticPrior:
        """The linear response."""
        return self.newton.prior

    @property
    def refinement(self) -> dict[str, Any] | None:
        """How cells were refined under the probe where it was taught (`mixpinn.fem.LocalRefinement`); None: not."""
        found: dict[str, Any] | None = self.about.get("refinement")
        return found

    @property
    def made_on(self) -> str:
        """Elements and size of the mesh in words, and what its cells were refined to in the simulations."""
        return discretisation_of(self.mesh, self.about.get("refined_to", ""))

    @cached_property
    def near_answer(self) -> NearAnswer:
        """What outputs ask on a mesh of many cells; laid out once for all of them."""
        return NearAnswer(self.newton)

    @staticmethod
    def of_prior(prior: ElasticPrior, equilibrium: Equilibrium) -> "HybridModel":
        """The prior alone: no modes, nothing fitted yet."""
        nothing = Rows.of(np.zeros((0, prior.coordinates.size)))
        none = np.zeros((0, prior.compliance.shape[0]), np.float32)
        newton = ModalNewton(prior, equilibrium, nothing, nothing, none)
        return HybridModel(newton, none, np.zeros((0, 0), np.float32), name=prior.name)

    def solve(self, nodes: AnyArray, displacement: AnyArray) -> HybridState:
        """Predict the reduced unknowns.

        Args:
            nodes: contact nodes, distinct, shape (l,).
            displacement: of each [mm], shape (l, 3).

        Raises:
            InputError: a node that the prior was not prepared for.
        """
        state = self.respond(nodes, displacement)
        unknowns = self.newton.add_modes(state.correction, state.response)
        unknowns[state.contact.unknowns] = np.asarray(displacement, dtype=np.float32).ravel()
        return replace(state, unknowns=unknowns)

    def respond(self, nodes: AnyArray, displacement: AnyArray) -> HybridState:
        """As `solve`, with the unknowns still those of the response: what z adds may be wanted in few places only."""
        contact = self.prior.hold(nodes)
        force = contact.solve(np.asarray(displacement).ravel())
        response = self.prior.respond_to_forces(contact, force)
        step = self.newton.step(response, contact) if len(self.newton.modes) else np.zeros(0, np.float32)
        correction, coordinates = self.correct(contact, force, step)
        return HybridState(contact, response, force, response, step, correction, coordinates)

    def correct(
        self, contact: ContactSystem, force: FloatArray, step: Float32Array,
    ) -> tuple[Float32Array, Float32Array]:
        """z (m,) and the coordinates a (k,) of the prior's answer to forces (3 l,) [N] with the Newton step ν (m,)."""
        coordinates = self.readers[:, contact.rows] @ force.astype(np.float32)
        return self._within_reach(step, features(step, coordinates) @ self.gain), coordinates

    def _within_reach(self, step: Float32Array, correction: Float32Array) -> Float32Array:
        """The correction z with |z − ℓ ν| cut back to `reach` |ν|; continuous in both."""
        if np.isinf(self.reach):
            return correction
        physical = np.float32(self.newton_length) * step
        learned = correction - physical
        size, limit = float(np.linalg.norm(learned)), self.reach * float(np.linalg.norm(step))
        if size <= limit:
            return correction
        cut: Float32Array = (physical + (limit / size) * learned).astype(np.float32)
        return cut

    def predict(self, nodes: AnyArray, displacements: AnyArray) -> Float32Array:
        """Displacement of every node [mm], float32, shape (n, 3), from that of contact nodes; operands of `solve`."""
        return self.expand(self.solve(nodes, displacements))

    def expand(self, state: HybridState) -> Float32Array:
        """The field of a state [mm], float32, shape (n, 3)."""
        return self.prior.expand(state.unknowns)

    def signs(self, state: HybridState) -> Signs:
        """What the error of a prediction shows in; costs one more evaluation of the equilibrium."""
        remaining = self.newton.step(state.unknowns, state.contact, state.unknowns - state.response)
        return Signs.of(state.step, state.correction, remaining, state.coordinates)

    def save(self, folder: Path | str, *, tolerance: float = 0.0, packed: bool = False) -> None:
        """Write the arrays as safetensors, the prior beside them (see `ElasticPrior.save`), and ``hybrid.json``."""
        folder = Path(folder)
        self.prior.save(folder / PRIOR_FOLDER, tolerance=tolerance, packed=packed)
        arrays: dict[str, AnyArray] = {
            "coupling": self.newton.coupling, "readers": self.readers, "gain": self.gain,
        }
        for name, rows in (("modes", self.newton.modes), ("duals", self.newton.duals)):
            kept = rows.packed() if packed else rows
            arrays[name] = kept.numbers
            if kept.scale is not None:
                arrays[f"{name}_scale"] = kept.scale
        write_arrays(folder / _TENSORS, arrays)
        write_json(folder / HYBRID_FILE, {
            "format": _FORMAT, "mesh_hash": self.mesh.hash(), "mu": self.newton.equilibrium.mu,
            "lam": self.newton.equilibrium.lam, "name": self.name, "about": self.about,
            "error": self.error.as_dict() if self.error is not None else None,
            "discretisation": discretisation_of(self.mesh),
            "newton_length": self.newton_length, "reach": self.reach if np.isfinite(self.reach) else None,
            "near": None if self.newton.near is None else self.newton.near.reach,
        })
        mesh = [MESH_FILE] if (folder / MESH_FILE).is_file() else []
        BUNDLE.seal(folder, [HYBRID_FILE, _TENSORS, _PRIOR_MANIFEST, *mesh])

    @staticmethod
    def load(folder: Path | str, mesh: TissueMesh) -> "HybridModel":
        """Read what `save` wrote; no code in it is run.

        Raises:
            InputError: absent, damaged, or of another mesh.
        """
        folder = Path(folder)
        BUNDLE.check(folder, HYBRID_FILE, _TENSORS, _PRIOR_MANIFEST)
        values = load_record(_About, folder / HYBRID_FILE, remake=BUNDLE.remake)
        if values.mesh_hash != mesh.hash():
            raise InputError(
                str(folder), expected=f"a model of {discretisation_of(mesh)}",
                got=f"one of {values.discretisation or f'mesh {values.mesh_hash}'}", fix="fit it on this mesh",
            )
        prior = ElasticPrior.load(folder / PRIOR_FOLDER, mesh)
        arrays = _checked(read_arrays(folder / _TENSORS)[0], prior, str(folder / _TENSORS))
        try:
            equilibrium = Equilibrium(
                mesh, mu=np.array(values.mu), lam=np.array(values.lam), restraints=prior.restraints,
            )
            modes, duals = (Rows(arrays[name], arrays.get(f"{name}_scale")) for name in ("modes", "duals"))
            near = None
            if values.near is not None:
                near = _near(values.near, mesh, equilibrium, prior, str(folder / HYBRID_FILE))
            newton = ModalNewton(prior, equilibrium, modes, duals, arrays["coupling"], near)
            where, size = f"{folder / HYBRID_FILE}: error", len(arrays["readers"])
            error = None if values.error is None else ErrorEstimate.of_dict(
                values.error, where, coordinates=size, remake=BUNDLE.remake,
            )
            return HybridModel(
                newton, arrays["readers"], arrays["gain"], error, values.about, values.name, values.newton_length,
                np.inf if values.reach is None else values.reach,
            )
        except (KeyError, TypeError) as found:
            raise InputError(
                str(folder), expected="a complete hybrid model", got=repr(found), fix="fit the model again",
            ) from found


def _near(
    reach: float, mesh: TissueMesh, equilibrium: Equilibrium, prior: ElasticPrior, where: str,
) -> NearCells:
    """Cells within `reach` [mm] of contact, when the body is one whose cells may be left out.

    Raises:
        InputError: it is not.
    """
    whole = mesh.order == 1 or equilibrium.rests_on_skin
    if whole or not 0.0 < reach < np.inf:
        raise InputError(
            f"{where}: near", expected="null: all cells of this body count" if whole else "a length above zero [mm]",
            got=f"{reach:g}", fix=BUNDLE.remake,
        )
    return NearCells(mesh, equilibrium, prior.nodes, reach)


def _checked(arrays: Mapping[str, AnyArray], prior: ElasticPrior, where: str) -> Mapping[str, AnyArray]:
    """The arrays of a bundle, when all are there, finite, and fit together and with the prior.

    Raises:
        InputError: one is absent or another than it must be.
    """
    extents = {"unknowns": prior.coordinates.size, "rows": prior.compliance.shape[0]}
    for name, spec in _ARRAYS.items():
        if name not in arrays:
            raise InputError(where, expected=f"the array '{name}'", got="none of this name", fix=BUNDLE.remake)
        spec.check(arrays[name], f"{where}: {name}", extents=extents, remake=BUNDLE.remake)
    for name in ("modes", "duals"):
        integers = arrays[name].dtype == np.int16
        if integers and f"{name}_scale" not in arrays:
            raise InputError(
                where, expected=f"the array '{name}_scale'", got="none of this name", fix=BUNDLE.remake,
            )
        if integers:
            _SCALE.check(arrays[f"{name}_scale"], f"{where}: {name}_scale", extents=extents, remake=BUNDLE.remake)
    modes, coordinates = extents["modes"], extents["coordinates"]
    wanted = modes + coordinates + coordinates * (coordinates + 1) // 2
    if extents["features"] != wanted:
        raise InputError(
            f"{where}: gain", expected=f"{wanted} rows, one a feature", got=str(extents["features"]), fix=BUNDLE.remake,
        )
    return arrays


def load_bundle_mesh(folder: Path | str) -> TissueMesh:
    """The mesh of a bundle.

    Raises:
        InputError: absent or altered.
    """
    BUNDLE.check(folder, MESH_FILE)
    return TissueMesh.load(Path(folder) / MESH_FILE)


def features(step: AnyArray, coordinates: AnyArray) -> Float32Array:
    """φ = [ν, a, a_i a_j for i ≤ j], shapes (…, m) and (…, k) → (…, m + k + k (k + 1) / 2)."""
    joined: Float32Array = np.concatenate([step, quadratic_features(coordinates)], axis=-1).astype(np.float32)
    return joined
