"""Files of a `ClusteredCompliance`: arrays by name, and what must hold of them."""

from collections.abc import Mapping

import numpy as np

from mixpinn.base.arrays import AnyArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.validated import ArraySpec
from mixpinn.reduced.compliance.clusters import Cluster, ClusteredCompliance, rows_of
from mixpinn.reduced.compliance.rows import Rows

SPECS = {
    "cluster": ArraySpec("index", ("contacts",), low=0), "close": ArraySpec("flag", ("clusters", "nodes_inside")),
    "near": ArraySpec("index", ("numbers",)), "near_scale": ArraySpec("number", ("rows",)),
    "far": ArraySpec("index", ("modes", "inside")), "far_scale": ArraySpec("number", ("modes",)),
    "modes": ArraySpec("index", ("clusters",), low=0), "left": ArraySpec("number", ("coefficients",)),
    "exact": ArraySpec("number", ("rows", "others")),
}
"""Cluster of each contact node; nodes inside near each cluster; N one cluster after another, by rows; V likewise;
modes of each cluster; U likewise; columns of other unknowns."""
MAPPED = ("near", "far")
"""Read where they are first needed."""


def arrays_of(compliance: ClusteredCompliance) -> dict[str, AnyArray]:
    """What is written."""
    clusters = compliance.clusters
    cluster, near_scale = np.empty(len(compliance.exact) // 3, np.int32), np.empty(len(compliance.exact), np.float32)
    close = np.zeros((len(clusters), len(compliance.inside) // 3), dtype=bool)
    for number, each in enumerate(clusters):
        cluster[each.rows[::3] // 3], near_scale[each.rows] = number, each.near.scale
        close[number, each.close[::3] // 3] = True
    return {
        "cluster": cluster, "close": close, "near": np.concatenate([each.near.numbers.ravel() for each in clusters]),
        "near_scale": near_scale, "far": np.concatenate([each.far.numbers for each in clusters]),
        "far_scale": np.concatenate([each.far.scale for each in clusters if each.far.scale is not None]),
        "modes": np.array([len(each.far) for each in clusters], np.int32),
        "left": np.concatenate([each.left.ravel() for each in clusters]), "exact": compliance.exact,
    }


def compliance_of(
    arrays: Mapping[str, AnyArray], unknowns: IntArray, *, where: str, remake: str,
) -> ClusteredCompliance:
    """What was written, when the arrays (each as `SPECS` has it) fit together.

    Raises:
        InputError: they do not.
    """
    modes, clusters = arrays["modes"].astype(np.int64), []
    near = left = far = 0
    last = int(arrays["cluster"].max(initial=-1))
    if last >= len(modes):
        raise InputError(
            f"{where}: cluster", expected=f"numbers below {len(modes)}, as its clusters say", got=str(last), fix=remake,
        )
    rows = 3 * np.bincount(arrays["cluster"], minlength=len(modes))
    wanted = {
        "near": int((rows * 3 * arrays["close"].sum(axis=1)).sum()), "left": int((rows * modes).sum()),
        "far": int(modes.sum()),
    }
    for name, count in wanted.items():
        if len(arrays[name]) != count:
            raise InputError(
                f"{where}: {name}", expected=f"{count} entries, as its clusters say", got=str(len(arrays[name])),
                fix=remake,
            )
    for number, (size, rank) in enumerate(zip(rows, modes, strict=True)):
        own = rows_of(np.flatnonzero(arrays["cluster"] == number))
        close = rows_of(np.flatnonzero(arrays["close"][number]))
        clusters.append(Cluster(
            own, close,
            Rows(arrays["near"][near: near + size * len(close)].reshape(size, len(close)), arrays["near_scale"][own]),
            arrays["left"][left: left + size * rank].reshape(size, rank),
            Rows(arrays["far"][far: far + rank], arrays["far_scale"][far: far + rank]),
        ))
        near, left, far = near + size * len(close), left + size * rank, far + rank
    return ClusteredCompliance(tuple(clusters), arrays["exact"], unknowns)


def of_one_cluster(numbers: AnyArray, scale: AnyArray, exact: AnyArray, unknowns: IntArray) -> ClusteredCompliance:
    """What earlier versions wrote: all nodes inside near one cluster; `numbers` (R, I) and `scale` (R,)."""
    rows, inside = numbers.shape
    whole = Cluster(
        np.arange(rows), np.arange(inside), Rows(numbers, scale), np.zeros((rows, 0), np.float32),
        Rows(np.zeros((0, inside), np.int16), np.zeros(0, np.float32)),
    )
    return ClusteredCompliance((whole,), exact, unknowns)
