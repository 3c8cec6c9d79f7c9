"""Where to press: a grid of positions on the skin over the rigid parts."""

from collections.abc import Iterator

import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.progress import track
from mixpinn.dataset.protocol import Pose, Protocol, list_poses
from mixpinn.geometry.farthest_points import distances_between, farthest_first
from mixpinn.geometry.first_touch import first_touch
from mixpinn.geometry.probe_pose import probe_rotation
from mixpinn.records import Probe, TissueMesh

_ALONG = 0.5
"""A pressing direction with a larger part along z presses the ends themselves."""


def plane_axes(direction: FloatArray) -> FloatArray:
    """Two unit vectors that span the plane across `direction`, shape (2, 3); x and z for the direction −y."""
    return probe_rotation(0.0, direction)[:, [0, 2]].T


def cast_rays(
    starts: FloatArray, direction: FloatArray, *, points: FloatArray, triangles: IntArray,
) -> FloatArray:
    """Distance along `direction` from each start to the first triangle that it meets, infinite where none.

    Möller and Trumbore (1997), all rays parallel: start + t d = a + u (b − a) + v (c − a) with u, v ≥ 0, u + v ≤ 1.

    Args:
        starts: [mm], shape (r, 3).
        direction: of length 1, shape (3,).
        points: vertices [mm], shape (p, 3).
        triangles: shape (t, 3).

    Returns:
        Distances [mm], shape (r,).
    """
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    first, second = b - a, c - a
    across = np.cross(direction, second)
    determinant = np.einsum("ij,ij->i", first, across)
    facing = np.abs(determinant) > 1e-12
    a, first, second, across, determinant = (item[facing] for item in (a, first, second, across, determinant))
    distances = np.full(len(starts), np.inf)
    for index, start in enumerate(starts):
        offset = start - a
        u = np.einsum("ij,ij->i", offset, across) / determinant
        turned = np.cross(offset, first)
        v = turned @ direction / determinant
        t = np.einsum("ij,ij->i", second, turned) / determinant
        met = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9) & (t >= 0.0)
        if met.any():
            distances[index] = t[met].min()
    return distances


def _centred_ticks(low: float, high: float, spacing: float) -> FloatArray:
    count = int(np.floor((high - low) / spacing + 1e-9)) + 1
    ticks: FloatArray = (low + high) / 2.0 + (np.arange(count, dtype=np.float64) - (count - 1) / 2.0) * spacing
    return ticks


def thin_positions(positions: FloatArray, count: int | None) -> FloatArray:
    """At most `count` of `positions`, spread evenly: each next one is the farthest from those chosen before.

    The first is the one nearest the centroid; the result keeps the order of `positions`.
    """
    if count is None or len(positions) <= count:
        return positions
    first = int(np.argmin(np.linalg.norm(positions - positions.mean(axis=0), axis=1)))
    chosen = farthest_first(distances_between(positions), first=first, count=count)
    return positions[np.sort(chosen)]


def pressed_part(probe: Probe, depth: float) -> FloatArray:
    """Points that bound what of `probe` lies up to `depth` above its tip [mm], shape (p, 3)."""
    points, height = probe.points, probe.points[:, 1]
    edges = np.concatenate([probe.triangles[:, [0, 1]], probe.triangles[:, [1, 2]], probe.triangles[:, [2, 0]]])
    low, high = edges[np.arange(len(edges)), np.argsort(height[edges], axis=1).T]
    cut = (height[low] < depth) & (height[high] > depth)
    low, high = low[cut], high[cut]
    share = (depth - height[low]) / (height[high] - height[low])
    return np.concatenate([points[height <= depth], points[low] + share[:, None] * (points[high] - points[low])])


def reachable_ends(mesh: TissueMesh, protocol: Protocol, probe: Probe) -> tuple[float, float]:
    """Lowest and highest z of a tip at which no rotation of the grid has the probe hang over an end of the mesh [mm].

    A scan ends somewhere; beyond its first and last slice there is no skin that would carry the rest of the probe.
    """
    part = pressed_part(probe, float(protocol.depths.max()) + probe.points[:, 1].min())
    reach = np.concatenate([part @ probe_rotation(angle, protocol.direction)[2] for angle in protocol.rotations])
    return float(mesh.points[:, 2].min() - reach.min()), float(mesh.points[:, 2].max() - reach.max())


def left_at_ends(mesh: TissueMesh, protocol: Protocol, probe: Probe) -> tuple[float, float]:
    """How much of the pressed bones' extent along z is no place for a probe, at either end [mm]; 0 where all is."""
    if abs(protocol.unit_direction[2]) > _ALONG:
        return 0.0, 0.0
    low, high = reachable_ends(mesh, protocol, probe)
    z = mesh.pressed_points[:, 2]
    if not mesh.n_parts or not ((z >= low) & (z <= high)).any():
        return 0.0, 0.0
    return max(low - float(z.min()), 0.0), max(float(z.max()) - high, 0.0)


def grid_positions(mesh: TissueMesh, protocol: Protocol, *, probe: Probe | None = None) -> FloatArray:
    """Positions on the skin over the pressed bones, every `protocol.spacing`, centred on their extent [mm], (p, 3).

    Each is the first point of the skin that a ray along the pressing direction meets. A mesh without rigid parts
    is covered over its whole extent less one spacing on each side.

    Args:
        mesh: what is pressed.
        protocol: spacing, rotations and pressing direction.
        probe: where it would hang over an end of the mesh (`reachable_ends`), bones are not covered, unless that
            leaves none.

    Raises:
        InputError: no ray meets the skin.
    """
    direction, axes = protocol.unit_direction, plane_axes(protocol.unit_direction)
    covered = mesh.pressed_points
    if probe is not None and any(left_at_ends(mesh, protocol, probe)):
        bottom, top = reachable_ends(mesh, protocol, probe)
        covered = covered[(covered[:, 2] >= bottom) & (covered[:, 2] <= top)]
    low, high = (covered @ axes.T).min(axis=0), (covered @ axes.T).max(axis=0)
    if not mesh.n_parts:
        low, high = low + protocol.spacing, high - protocol.spacing
    across = [_centred_ticks(*limits, protocol.spacing) for limits in zip(low, high, strict=True)]
    first, second = np.meshgrid(*across)
    above = float((mesh.points @ direction).min()) - 1.0
    starts = np.column_stack([first.ravel(), second.ravel()]) @ axes + above * direction
    distances = cast_rays(starts, direction, points=mesh.points, triangles=mesh.skin_faces)
    positions = (starts + distances[:, None] * direction)[np.isfinite(distances)] if len(starts) else starts
    if not len(positions):
        raise InputError(
            "probe positions", expected="skin over the rigid parts", got="no ray that meets it",
            fix="check the pressing direction or give the positions in a file",
        )
    return thin_positions(positions, protocol.max_positions)


def plan_poses(
    positions: FloatArray, protocol: Protocol, *, mesh: TissueMesh, probe: Probe, gap: float,
) -> tuple[Pose, ...]:
    """Poses of the protocol at `positions` [mm], shape (p, 3), with the origin of each path as `protocol.start` says.

    Raises:
        InputError: a position beside the body (only where the path begins at first touch).
    """
    listed = list_poses(positions, protocol)
    if protocol.start == "listed":
        return listed
    return tuple(_touching(listed, protocol, mesh, probe, gap))


def _touching(
    poses: tuple[Pose, ...], protocol: Protocol, mesh: TissueMesh, probe: Probe, gap: float,
) -> Iterator[Pose]:
    for pose in track(poses, "first touch"):
        x, y, z = first_touch(
            np.array(pose.position), probe_rotation(pose.rotation_deg, protocol.unit_direction), points=mesh.points,
            triangles=mesh.skin_faces, probe=probe, gap=gap,
        )
        yield Pose(pose.position_index, (float(x), float(y), float(z)), pose.rotation_deg)
