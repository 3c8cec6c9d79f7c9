"""Motion of one rigid part against another at a joint, with exact first and second derivatives.

Both parts carry a copy of the joint's frame; at rest the two coincide. With the frame's current origins x₁, x₂ [mm] and
axes A₁, A₂ (columns) on the first and second part the motion is

    q = (u, θ),    u = A₁ᵀ (x₂ − x₁),    exp([θ]) = A₁ᵀ A₂,

the second part's displacement and rotation vector as the first part sees them. A rigid motion of both leaves q as it
is, so that whatever depends on q alone is objective and its wrenches are equal and opposite.

The frame of the first part is chosen, not one halfway between the two: it is what a testing machine measures, with one
vertebra clamped and the other loaded, the derivatives stay short, and forces that are given along the axes (a preload)
follow one bone. The price is that exchanging the two parts changes the force of a law on u by the part θ × u.

Derivatives are with respect to the twists (δt₁, δw₁, δt₂, δw₂) of the parts, R ← exp([δw]) R, as
`mixpinn.fem.ElasticSystem` moves its parts. For the rotation, A₁ᵀ exp(−[w₁]) exp([w₂]) A₂ = exp([θ]) exp([s]) with

    s = β − α − ½ α × β + …,    α = A₂ᵀ w₁, β = A₂ᵀ w₂  (Baker, Campbell, Hausdorff),
    dθ/ds = B(θ) = 1 + ½ [θ] + c [θ]²,    c = (1 − (x/2) cot(x/2)) / x²,    x = |θ|,

B the inverse of the right Jacobian of the exponential map. As s ↦ τ s runs along a geodesic, θ' = B(θ) s throughout,
hence θ'' = (DB(θ)[B s]) s: the second derivative of the logarithm needs only the derivative of B.
"""

from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.geometry.rotations import skew, vector_from_rotation
from mixpinn.physics.joint_kernel import factors, motion_and_gradient


@dataclass(frozen=True, eq=False)
class CarriedFrame:
    """A joint's frame on one of its parts.

    Attributes:
        axes: current axes of the frame as columns, shape (3, 3).
        arm: origin of the frame less the part's centroid, current [mm], shape (3,).
        centroid: current centroid of the part [mm], shape (3,).
    """

    axes: FloatArray
    arm: FloatArray
    centroid: FloatArray

    @property
    def origin(self) -> FloatArray:
        """Current origin of the frame [mm], shape (3,)."""
        return self.centroid + self.arm


def relative_motion(first: CarriedFrame, second: CarriedFrame) -> FloatArray:
    """q = (u, θ) [mm, rad], shape (6,); smooth while the parts are turned by less than π against each other."""
    return _motion_and_gradient(first, second)[0]


def motion_gradient(first: CarriedFrame, second: CarriedFrame) -> FloatArray:
    """∂q/∂(δt₁, δw₁, δt₂, δw₂), shape (6, 12)."""
    return _motion_and_gradient(first, second)[1]


def _motion_and_gradient(first: CarriedFrame, second: CarriedFrame) -> tuple[FloatArray, FloatArray]:
    motion, gradient = np.empty(6), np.empty((6, 12))
    motion_and_gradient(
        np.ascontiguousarray(first.axes), np.ascontiguousarray(second.axes), np.stack([first.arm, second.arm]),
        np.stack([first.centroid, second.centroid]), motion, gradient,
    )
    return motion, gradient


def motion_curvature(first: CarriedFrame, second: CarriedFrame, wrench: FloatArray) -> FloatArray:
    """Σ_i f_i ∂²q_i: Hessian of f · q by the twists, f held constant, shape (12, 12), symmetric.

    Args:
        first, second: the joint's frame on the two parts.
        wrench: f, conjugate to q: force and moment in the axes of the first part [N, N mm], shape (6,).
    """
    curvature = np.zeros((12, 12))
    t1, w1, t2, w2 = (slice(3 * k, 3 * k + 3) for k in range(4))

    # f · u = f · exp(−[w₁]) (D + t₂ − t₁ + exp([w₂]) r₂) + constant, f in world axes, D + r₂ = reach, to second order
    force = first.axes @ wrench[:3]
    reach = second.origin - first.centroid
    curvature[w1, w1] = _double_turn(force, reach)
    curvature[w2, w2] = _double_turn(force, second.arm)
    curvature[w1, t1], curvature[w1, t2] = -skew(force), skew(force)
    curvature[w1, w2] = -skew(force) @ skew(second.arm)

    # moment · θ with θ(s), s(α, β)
    turn = vector_from_rotation(first.axes.T @ second.axes)
    jacobian = inverse_right_jacobian(turn)
    moment = wrench[3:]
    product = _jacobian_slope(turn, moment) @ jacobian
    bend = 0.5 * (product + product.T)
    cross = 0.5 * skew(jacobian.T @ moment)
    axes = second.axes
    curvature[w1, w1] += axes @ bend @ axes.T
    curvature[w2, w2] += axes @ bend @ axes.T
    curvature[w1, w2] += axes @ (cross - bend) @ axes.T

    curvature[t1, w1], curvature[t2, w1] = curvature[w1, t1].T, curvature[w1, t2].T
    curvature[w2, w1] = curvature[w1, w2].T
    return curvature


def inverse_right_jacobian(vector: FloatArray) -> FloatArray:
    """B(θ) = 1 + ½ [θ] + c [θ]²: derivative of log(exp([θ]) exp([s])) by s at zero, shape (3, 3)."""
    generator = skew(vector)
    factor, _ = factors(float(np.linalg.norm(vector)))
    jacobian: FloatArray = np.eye(3) + 0.5 * generator + factor * (generator @ generator)
    return jacobian


def _jacobian_slope(vector: FloatArray, moment: FloatArray) -> FloatArray:
    """N with m · (DB(θ)[δ] s) = s · N δ, shape (3, 3)."""
    factor, slope = factors(float(np.linalg.norm(vector)))
    generator, twist = skew(vector), skew(moment)
    twice = generator @ (generator @ moment)
    matrix: FloatArray = (
        0.5 * twist + slope * np.outer(twice, vector) - factor * (generator @ twist + skew(generator @ moment))
    )
    return matrix


def _double_turn(force: FloatArray, arm: FloatArray) -> FloatArray:
    """Hessian of f · exp([w]) d (or of exp(−[w])) by w at zero: ½ (d fᵀ + f dᵀ) − (f · d) 1, shape (3, 3)."""
    product = np.outer(arm, force)
    matrix: FloatArray = 0.5 * (product + product.T) - float(arm @ force) * np.eye(3)
    return matrix
