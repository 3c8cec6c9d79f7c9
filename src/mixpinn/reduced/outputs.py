"""Outputs: the hybrid model's answer at some nodes alone, for less than the whole field costs.

What z adds to the prior's response is summed up over the unknowns of these nodes only: over the vertices of a mesh of
ten-node cells, a seventh of all. The residual behind z needs the whole response where all cells count for it. Where
none is needed, or on a mesh of many cells, of which those near contact count, the prior is asked there and at the
chosen nodes alone.
"""

from collections.abc import Callable

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.reduced.compliance.clusters import ClusteredCompliance
from mixpinn.reduced.hybrid import HybridModel
from mixpinn.reduced.prior import ContactSystem

Checked = Callable[[AnyArray, AnyArray], tuple[AnyArray, AnyArray]]


class Outputs:
    """Displacements of chosen nodes, in the order in which they were chosen.

    They are used like this::

        vertices = Outputs(model, np.arange(model.mesh.n_points))
        moved = vertices.predict(contact_nodes, displacements)
    """

    def __init__(self, model: HybridModel, nodes: AnyArray, *, checked: Checked | None = None) -> None:
        """Prepare.

        Args:
            model: contact displacement in, displacement out.
            nodes: of its mesh, shape (k,).
            checked: what contact nodes and displacements from outside must pass; returns them.

        Raises:
            InputError: a node that the mesh does not have.
        """
        chosen, mesh, coordinates = np.asarray(nodes, dtype=np.int64).ravel(), model.mesh, model.prior.coordinates
        if len(chosen) and not (chosen.min() >= 0 and chosen.max() < mesh.n_nodes):
            raise InputError(
                "nodes", expected=f"nodes of the mesh, 0 to {mesh.n_nodes - 1}",
                got=f"{chosen.min()} to {chosen.max()}", fix="ask for nodes of the mesh",
            )
        self.model, self.nodes, self._checked = model, chosen, checked
        order = np.minimum(np.searchsorted(coordinates.free, chosen), len(coordinates.free) - 1)
        self._soft: IntArray = np.flatnonzero(coordinates.free[order] == chosen)
        soft = (3 * order[self._soft][:, None] + np.arange(3)).ravel()
        self._unknowns: IntArray = np.concatenate([soft, np.arange(coordinates.n_soft, coordinates.size)])
        self._place: IntArray = np.full(coordinates.size, -1)
        self._place[soft] = np.arange(len(soft))
        self._modes = model.newton.modes.columns(self._unknowns)
        compliance, correcting = model.prior.compliance, bool(len(model.newton.modes))
        self._chosen: ClusteredCompliance | None = None  # where nothing needs the prior's answer as a whole
        if isinstance(compliance, ClusteredCompliance) and not (correcting and model.newton.near is None):
            distinct, self._again = np.unique(self._unknowns, return_inverse=True)
            self._chosen = compliance.columns(distinct)
        self._newton = model.near_answer if self._chosen is not None and correcting else None
        self._parts: list[tuple[int, IntArray, FloatArray]] = []
        for number, (members, arms) in enumerate(zip(coordinates.parts, coordinates.arms, strict=True)):
            at = np.minimum(np.searchsorted(members, chosen), max(len(members) - 1, 0))
            of_part = np.flatnonzero(members[at] == chosen) if len(members) else np.empty(0, dtype=np.int64)
            if len(of_part):
                self._parts.append((number, of_part, arms[at[of_part]]))

    def predict(self, nodes: AnyArray, displacements: AnyArray) -> Float32Array:
        """Displacement of the chosen nodes [mm], float32, shape (k, 3); operands and errors of `HybridModel.solve`."""
        if self._checked is not None:
            nodes, displacements = self._checked(nodes, displacements)
        contact, found, correction = self._respond(nodes, displacements)
        self._modes.add_to(found, correction)
        held = self._place[contact.unknowns]
        asked = held >= 0
        found[held[asked]] = np.asarray(displacements, dtype=np.float32).ravel()[asked]
        field = np.zeros((len(self.nodes), 3), dtype=np.float32)
        twists = found[3 * len(self._soft):].astype(np.float64).reshape(-1, 6)
        field[self._soft] = found[: 3 * len(self._soft)].reshape(-1, 3)
        for number, rows, arms in self._parts:
            turn = rotation_from_vector(twists[number, 3:]) - np.eye(3)
            field[rows] = twists[number, :3] + arms @ turn.T
        return field

    def _respond(self, nodes: AnyArray, displacements: AnyArray) -> tuple[ContactSystem, Float32Array, Float32Array]:
        """The contact nodes, the prior's answer at the chosen unknowns (k,), and the correction z (m,)."""
        if self._chosen is None:
            state = self.model.respond(nodes, displacements)
            return state.contact, state.response[self._unknowns], state.correction
        contact = self.model.prior.hold(nodes)
        force = contact.solve(np.asarray(displacements).ravel())
        step = np.zeros(0, dtype=np.float32) if self._newton is None else self._newton.step(contact, force)
        correction, _ = self.model.correct(contact, force, step)
        return contact, self._chosen.respond(contact.rows, force)[self._again], correction
