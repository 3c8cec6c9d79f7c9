"""Motion and gradient of one joint as compiled code: what `mixpinn.physics.joint_motion` says, for every prediction."""

from math import atan2, sin, sqrt, tan

from numba import njit

from mixpinn.base.arrays import FloatArray, IntArray

_SERIES = (1.0 / 12.0, 1.0 / 720.0, 1.0 / 30240.0, 1.0 / 1209600.0, 1.0 / 47900160.0, 691.0 / 1307674368000.0)
"""|B₂ₙ| / (2n)!: (1 − (x/2) cot(x/2)) / x² = Σ of these times x²ⁿ⁻², n = 1, 2, …"""
_SMALL = 0.4


@njit(cache=True, nogil=True)
def factors(angle: float) -> tuple[float, float]:
    """c(x) and c'(x)/x."""
    if angle < _SMALL:
        square, value, slope = angle * angle, 0.0, 0.0
        for n in range(len(_SERIES) - 1, -1, -1):
            value = value * square + _SERIES[n]
        for n in range(len(_SERIES) - 1, 0, -1):
            slope = slope * square + 2.0 * n * _SERIES[n]
        return value, slope
    half = 0.5 * angle
    value = (1.0 - half / tan(half)) / angle**2
    slope = 0.5 / tan(half) - 0.25 * angle / sin(half) ** 2
    return value, (-slope / angle**2 - 2.0 * value / angle) / angle


@njit(cache=True, nogil=True)
def _turn(first: FloatArray, second: FloatArray, motion: FloatArray) -> None:
    """Rotation vector of A₁ᵀ A₂ into motion[3:], through the quaternion of largest component (Shepperd 1978)."""
    r = first.T.copy() @ second
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    largest = 0
    best = trace
    for i in range(3):
        if r[i, i] > best:
            largest, best = i + 1, r[i, i]
    if largest == 0:
        w, x, y, z = 1.0 + trace, r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    elif largest == 1:
        w, x, y, z = r[2, 1] - r[1, 2], 1.0 + 2.0 * r[0, 0] - trace, r[1, 0] + r[0, 1], r[0, 2] + r[2, 0]
    elif largest == 2:
        w, x, y, z = r[0, 2] - r[2, 0], r[1, 0] + r[0, 1], 1.0 + 2.0 * r[1, 1] - trace, r[2, 1] + r[1, 2]
    else:
        w, x, y, z = r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[2, 1] + r[1, 2], 1.0 + 2.0 * r[2, 2] - trace
    size = sqrt(w * w + x * x + y * y + z * z)
    if w < 0.0:
        size = -size
    w, x, y, z = w / size, x / size, y / size, z / size
    sine = sqrt(x * x + y * y + z * z)
    # w = 2 (θ/2) / sin(θ/2) · (x, y, z)
    stretch = 2.0 if sine == 0.0 else 2.0 * atan2(sine, w) / sine
    motion[3], motion[4], motion[5] = stretch * x, stretch * y, stretch * z


@njit(cache=True, nogil=True)
def motion_and_gradient(
    first: FloatArray, second: FloatArray, arms: FloatArray, centroids: FloatArray, motion: FloatArray,
    gradient: FloatArray,
) -> None:
    """q = (u, θ) and ∂q/∂(δt₁, δw₁, δt₂, δw₂), written in place.

    Args:
        first, second: A₁, A₂: current axes of the frame on both parts as columns, shape (3, 3).
        arms: origin of the frame on each part less its centroid, current [mm], shape (2, 3).
        centroids: current centroids of both parts [mm], shape (2, 3).
        motion: shape (6,).
        gradient: shape (6, 12).
    """
    _turn(first, second, motion)
    reach = centroids[1] + arms[1] - centroids[0]
    for i in range(3):
        motion[i] = 0.0
        for k in range(3):
            motion[i] += first[k, i] * (reach[k] - arms[0, k])

    x, y, z = motion[3], motion[4], motion[5]
    c, _ = factors(sqrt(x * x + y * y + z * z))
    # B(θ) = 1 + ½ [θ] + c [θ]², [θ]² = θ θᵀ − |θ|² 1
    square = x * x + y * y + z * z
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            gradient[i, j], gradient[i, 6 + j] = -first[j, i], first[j, i]
            gradient[i + 3, j], gradient[i + 3, 6 + j] = 0.0, 0.0
            # rows of A₁ᵀ [v]: the cross product of a column of A₁ with v
            p, q = (j + 1) % 3, (j + 2) % 3
            gradient[i, 3 + j] = first[p, i] * reach[q] - first[q, i] * reach[p]
            gradient[i, 9 + j] = first[q, i] * arms[1, p] - first[p, i] * arms[1, q]
            rotation = 0.0
            for k in range(3):
                entry = c * motion[3 + i] * motion[3 + k]
                if k == i:
                    entry += 1.0 - c * square
                elif k == b:
                    entry += 0.5 * motion[3 + a]
                else:
                    entry -= 0.5 * motion[3 + b]
                rotation += entry * second[j, k]
            gradient[i + 3, 3 + j], gradient[i + 3, 9 + j] = -rotation, rotation


@njit(cache=True, nogil=True)
def motions_and_gradients(
    rotation: FloatArray, translation: FloatArray, centroids: FloatArray, pairs: IntArray, origins: FloatArray,
    columns: FloatArray, motions: FloatArray, gradients: FloatArray,
) -> None:
    """The same for all joints of a body, from the poses of its K rigid parts.

    Args:
        rotation, translation: of the parts, shapes (K, 3, 3) and (K, 3) [mm].
        centroids: of the parts at rest [mm], shape (K, 3).
        pairs: first and second part of each joint, shape (j, 2).
        origins: of the frames at rest [mm], shape (j, 3).
        columns: axes of the frames at rest as columns, shape (j, 3, 3).
        motions, gradients: written in place, shapes (j, 6) and (j, 6, 12).
    """
    for j in range(len(pairs)):
        m, n = pairs[j]
        arms, places = origins[j] - centroids[pairs[j]], centroids[pairs[j]] + translation[pairs[j]]
        arms[0], arms[1] = rotation[m] @ arms[0], rotation[n] @ arms[1]
        motion_and_gradient(
            rotation[m] @ columns[j], rotation[n] @ columns[j], arms, places, motions[j], gradients[j],
        )
