"""Metrics of one predicted displacement field against its reference, as the paper's tables define them."""

from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.records import TissueMesh

AS_PUBLISHED = "_as_published"
"""Suffix of the second set of metrics, which counts virtual nodes and virtual edges too."""

SOFT = "soft"
"""Name of the soft tissue in the values by part."""


def part_label(name: str) -> str:
    """Name of a part as it is shown: ``Soft tissue`` for `SOFT`, ``L1`` for ``vertebrae_L1``."""
    return "Soft tissue" if name == SOFT else name.removeprefix("vertebrae_")


@dataclass(frozen=True, eq=False)
class VirtualTopology:
    """The virtual nodes and virtual edges that a model adds to the mesh of n nodes.

    Attributes:
        points: rest positions of the virtual nodes [mm], shape (v, 3); v may be 0.
        part: rigid part 1 … K of each virtual node, shape (v,).
        edges: undirected virtual edges, each once, shape (w, 2); mesh nodes are 0 … n − 1, virtual ones n … n + v − 1.
    """

    points: FloatArray
    part: IntArray
    edges: IntArray


@dataclass(frozen=True, eq=False)
class MetricGeometry:
    """What the metrics need to know of a mesh, collected once.

    Attributes:
        points: rest positions [mm], float64, shape (n, 3).
        part: 0 for soft tissue or rigid part 1 … K, shape (n,).
        rigid_edges: undirected edges with both ends in the same rigid part, shape (e, 2).
        part_names: names of the rigid parts 1 … K.
    """

    points: FloatArray
    part: IntArray
    rigid_edges: IntArray
    part_names: tuple[str, ...]

    @staticmethod
    def of(mesh: TissueMesh) -> "MetricGeometry":
        """The geometry of the mesh alone: no virtual node, no virtual edge."""
        return MetricGeometry(
            np.asarray(mesh.points, dtype=np.float64), mesh.part.astype(np.int64), mesh.edges[mesh.edge_part > 0],
            mesh.rigid_names,
        )

    def with_virtual(self, virtual: VirtualTopology) -> "MetricGeometry":
        """This geometry with the virtual nodes and edges of a model counted in."""
        return MetricGeometry(
            np.concatenate([self.points, virtual.points.reshape(-1, 3)]), np.concatenate([self.part, virtual.part]),
            np.concatenate([self.rigid_edges, virtual.edges.reshape(-1, 2)]), self.part_names,
        )


def euclidean_errors(predicted: AnyArray, reference: AnyArray) -> FloatArray:
    """Distance between predicted and reference position of each node [mm], shape (..., n).

    Args:
        predicted: displacement [mm], shape (..., n, 3).
        reference: displacement [mm], shape (..., n, 3).
    """
    difference = np.asarray(predicted, dtype=np.float64) - np.asarray(reference, dtype=np.float64)
    return np.sqrt(np.einsum("...k,...k->...", difference, difference))


def mean_euclidean_error(predicted: AnyArray, reference: AnyArray) -> FloatArray:
    """MEE [mm], shape (...,): the mean over nodes of the distance; operands as in `euclidean_errors`."""
    # L_MEE = 1/|V| Σ_i √((x_i − x̂_i)² + (y_i − ŷ_i)² + (z_i − ẑ_i)²)
    return euclidean_errors(predicted, reference).mean(axis=-1)


def mean_absolute_error(predicted: AnyArray, reference: AnyArray) -> FloatArray:
    """MAE per component [mm], shape (...,); operands as in `euclidean_errors`.

    The paper's printed equation sums the three components and lacks the absolute value; its tables hold the mean over
    nodes and components, which is what this computes.
    """
    # MAE = 1/(3|V|) Σ_i (|x_i − x̂_i| + |y_i − ŷ_i| + |z_i − ẑ_i|)
    difference = np.asarray(predicted, dtype=np.float64) - np.asarray(reference, dtype=np.float64)
    return np.abs(difference).mean(axis=(-2, -1))


def mean_squared_error(predicted: AnyArray, reference: AnyArray) -> FloatArray:
    """MSE per component [mm²], shape (...,); operands as in `euclidean_errors`."""
    # MSE = 1/(3|V|) Σ_i ((x_i − x̂_i)² + (y_i − ŷ_i)² + (z_i − ẑ_i)²)
    difference = np.asarray(predicted, dtype=np.float64) - np.asarray(reference, dtype=np.float64)
    return np.square(difference).mean(axis=(-2, -1))


def rigid_edge_error(displacement: AnyArray, points: AnyArray, rigid_edges: AnyArray) -> FloatArray:
    """REE [mm], shape (...,): the mean absolute change of length of the edges inside rigid parts.

    Directed or undirected edges give the same mean. All arithmetic is in float64.

    Args:
        displacement: predicted displacement [mm], shape (..., n, 3).
        points: rest positions [mm], shape (n, 3).
        rigid_edges: node pairs, shape (e, 2), e > 0.
    """
    first, second = np.asarray(rigid_edges).T
    rest = np.asarray(points, dtype=np.float64)
    field = np.asarray(displacement, dtype=np.float64)
    edge = rest[second] - rest[first]
    stretch = field[..., second, :] - field[..., first, :]
    length = np.linalg.norm(edge, axis=-1)
    deformed = np.linalg.norm(edge + stretch, axis=-1)
    # REE = 1/|E_rigid| Σ |l̂ − l|. With e the edge and s its change, l̂² − l² = s·(2e + s), so that
    # l̂ − l = s·(2e + s) / (l̂ + l), which unlike the difference of two lengths loses no digits.
    change = np.einsum("...k,...k->...", stretch, 2.0 * edge + stretch) / (deformed + length)
    return np.abs(change).mean(axis=-1)


def sample_metrics(predicted: AnyArray, reference: AnyArray, geometry: MetricGeometry) -> dict[str, float]:
    """All metrics of one sample by name: ``mee``, ``mae``, ``mse``, ``rigid_mee``, ``soft_mee``, ``ree``.

    Those of rigid nodes or edges, or of soft nodes, are left out where the mesh has none.

    Args:
        predicted: displacement [mm], shape (n, 3).
        reference: displacement [mm], shape (n, 3).
        geometry: of the same n nodes.

    Raises:
        InputError: shapes that do not belong together, or a prediction that is not finite.
    """
    _check(predicted, reference, geometry)
    distance = euclidean_errors(predicted, reference)
    rigid = geometry.part > 0
    metrics = {
        "mee": float(distance.mean()),
        "mae": float(mean_absolute_error(predicted, reference)),
        "mse": float(mean_squared_error(predicted, reference)),
    }
    if rigid.any():
        metrics["rigid_mee"] = float(distance[rigid].mean())
    if not rigid.all():
        metrics["soft_mee"] = float(distance[~rigid].mean())
    if len(geometry.rigid_edges):
        metrics["ree"] = float(rigid_edge_error(predicted, geometry.points, geometry.rigid_edges))
    return metrics


def errors_by_part(predicted: AnyArray, reference: AnyArray, geometry: MetricGeometry) -> dict[str, float]:
    """MEE of the soft tissue and of each rigid part by name [mm]; parts without nodes are left out."""
    distance = euclidean_errors(predicted, reference)
    names = (SOFT, *geometry.part_names)
    total = np.bincount(geometry.part, weights=distance, minlength=len(names))
    count = np.bincount(geometry.part, minlength=len(names))
    return {name: float(total[k] / count[k]) for k, name in enumerate(names) if count[k]}


def virtual_reference(reference: AnyArray, geometry: MetricGeometry, virtual: VirtualTopology) -> FloatArray:
    """Reference displacement of mesh and virtual nodes [mm], shape (n + v, 3).

    A virtual node's target is the mean displacement of the nodes of its rigid part (paper, output displacement of VN).

    Args:
        reference: displacement of the mesh nodes [mm], shape (n, 3).
        geometry: of the mesh alone.
        virtual: the model's virtual nodes.
    """
    field = np.asarray(reference, dtype=np.float64)
    centres = [field[geometry.part == k].mean(axis=0) for k in virtual.part]
    return np.concatenate([field, np.reshape(centres, (-1, 3))])


def _check(predicted: AnyArray, reference: AnyArray, geometry: MetricGeometry) -> None:
    expected = (len(geometry.points), 3)
    for name, array in (("prediction", predicted), ("reference", reference)):
        if np.shape(array) != expected:
            raise InputError(
                name, expected=f"one displacement for each node, shape {expected}", got=f"shape {np.shape(array)}",
                fix="use a model and samples of the same mesh",
            )
    if not np.isfinite(predicted).all():
        raise InputError(
            "prediction", expected="finite displacements", got=f"{int((~np.isfinite(predicted)).sum())} other values",
            fix="train the model again with a lower learning rate",
        )
