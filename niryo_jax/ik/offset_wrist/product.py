"""The product of the one condition over its four branches: a trigonometric polynomial of degree 8.

With the signs of elbow and shoulder left open, f is a rational function of cos u, sin u and two
square roots: s = sin E and h, the reach along P2. Its conjugates are its branches, so their product
has no roots left in it; times the squares of the wrist's squared distances from the shoulder and
from axis 1 it has no denominator either, and is of degree 8 in u. Every solution is one of its
roots, also where the wrist offset is large. Derivation: docs/theory/complete-ik.md.
"""

from __future__ import annotations

from niryo_jax import lanes
from niryo_jax.ik.offset_wrist.parameters import OffsetWristParameters
from niryo_jax.ik.offset_wrist.wrist_circle import WristCircle
from niryo_jax.ik.trig_polynomial import Polynomial, interpolated, nodes
from niryo_jax.lanes import Lane


def product_of_branches(arm: OffsetWristParameters, circle: WristCircle) -> Polynomial:
    """The polynomial of the angle u on the circles of targets."""
    cos, sin = (Lane(x[:, None]) for x in nodes(circle.excess.array.dtype))
    return interpolated(lanes.materialise(_product(arm, circle, cos, sin)).array)


def _product(arm: OffsetWristParameters, circle: WristCircle, cos: Lane, sin: Lane) -> Lane:
    """Its value at an angle u."""
    side, second, axis_6 = circle.axes
    r, a, b, d = arm.radius, arm.upper_arm, arm.forearm, arm.sideways
    x, y, z = circle.centre + (r * cos) * side + (r * sin) * second
    h0, h1, h2 = arm.hand
    along, across = h1 * cos - h2 * sin, h1 * sin + h2 * cos
    # Axis 5: along the spoke of axis 1 to the wrist, times its length, and at right angles to it.
    x5, y5, z5 = h0 * axis_6 + along * side + across * second
    outward, sideward = x * x5 + y * y5, x * y5 - y * x5
    lean, upright = arm.shoulder_angle
    v = z if arm.is_planar else (z - d * lean) / upright
    w = d * upright - v * lean
    square = x * x + y * y
    inside = square - w * w
    away = v * v + inside
    cos_elbow = (away - a * a - b * b) / (2.0 * a * b)
    sin_square = (1.0 - cos_elbow) * (1.0 + cos_elbow)
    k0, k1, k2 = arm.axis_4
    ahead = a * cos_elbow + b
    # Axis 4 times `away`: p v - q h along P1, p h + q v along P2; both are affine in s = sin E.
    p, q = (k1 * ahead, -k2 * a), (k2 * ahead, k1 * a)
    if arm.is_planar:
        # f times `away` is n + m / h.
        forward, upward = v * z5 + outward, v * outward - z5 * square
        n = p[0] * forward - arm.wrist_angle * away, p[1] * forward
        m = k0 * away * sideward + q[0] * upward, q[1] * upward
        whole = square * (n[0] * n[0] + n[1] * n[1] * sin_square)
        whole = whole - (m[0] * m[0] + m[1] * m[1] * sin_square)
        mixed = 2.0 * (square * n[0] * n[1] - m[0] * m[1])
        return (whole * whole - sin_square * mixed * mixed) / (away * away)
    # f times `away` and `square` is n + m h.
    level = w * outward
    flat, upward = upright * level + lean * z5 * square, upright * z5 * square - lean * level
    along_p, along_q = v * upward + outward * inside, (lean * inside - v * w) * sideward
    n = (
        k0 * away * flat - arm.wrist_angle * away * square + p[0] * along_p + q[0] * along_q,
        p[1] * along_p + q[1] * along_q,
    )
    along_p, along_q = -(v * lean + w) * sideward, v * outward - upward
    m = (
        k0 * away * upright * sideward + p[0] * along_p + q[0] * along_q,
        p[1] * along_p + q[1] * along_q,
    )
    whole = n[0] * n[0] + n[1] * n[1] * sin_square
    whole = whole - inside * (m[0] * m[0] + m[1] * m[1] * sin_square)
    mixed = 2.0 * (n[0] * n[1] - inside * m[0] * m[1])
    return (whole * whole - sin_square * mixed * mixed) / (away * away * square * square)
