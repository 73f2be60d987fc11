"""The scan of theta6 of the independent judge (`exhaustive`): brackets, roots and joint angles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Geometry(NamedTuple):
    """The arm: unit axes and points on them (6, 3) each, and what the scan needs of them.

    `shoulder` is where axes 1 and 2 meet and `wrist` where 4 and 5 meet, at q = 0.
    """

    axis: np.ndarray
    point: np.ndarray
    shoulder: np.ndarray
    wrist: np.ndarray

    @classmethod
    def of(cls, screws: np.ndarray) -> Geometry:
        """From screw axes (6, 6)."""
        w, v = np.asarray(screws, float)[:, :3], np.asarray(screws, float)[:, 3:]
        point = np.cross(w, v)

        def meeting(i: int, j: int) -> np.ndarray:
            along, *_ = np.linalg.lstsq(np.stack([w[i], -w[j]], 1), point[j] - point[i], rcond=None)
            first, second = point[i] + along[0] * w[i], point[j] + along[1] * w[j]
            assert np.linalg.norm(first - second) < 1e-9, f"axes {i + 1} and {j + 1} do not meet"
            return (first + second) / 2

        assert np.linalg.norm(np.cross(w[1], w[2])) < 1e-9, "axes 2 and 3 are not parallel"
        return cls(w, point, meeting(0, 1), meeting(3, 4))


def rodrigues(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Rotations (..., 3, 3) about one axis (3,) by angles (...,)."""
    x, y, z = axis
    hat = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    s, c = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
    return np.eye(3) + s * hat + (1 - c) * (hat @ hat)


class Circle(NamedTuple):
    """What theta6 leaves open, for P poses: x(theta) = x[0] + x[1] cos theta + x[2] sin theta.

    Attributes:
        p: (3, P, 3) from the shoulder to the wrist point.
        g: (3, P, 3) direction of axis 5 in the space frame.
    """

    p: np.ndarray
    g: np.ndarray


def circle(arm: Geometry, home: np.ndarray, poses: np.ndarray) -> Circle:
    """p = T M^-1 exp(-[S6] theta) W - O and g = R R6(theta)^T e5."""
    # The inverse of a home pose that is a rigid motion only to rounding must be its inverse.
    motion = poses @ np.linalg.inv(home)
    rotation, e6 = motion[:, :3, :3], arm.axis[5]
    away = arm.wrist - arm.point[5]
    foot = arm.point[5] + (away @ e6) * e6
    away = arm.wrist - foot

    def turning(vector: np.ndarray) -> list[np.ndarray]:
        along = (vector @ e6) * e6
        return [rotation @ v for v in (along, vector - along, -np.cross(e6, vector))]

    centre = rotation @ foot + motion[:, :3, 3] - arm.shoulder
    _, cosine, sine = turning(away)
    return Circle(np.stack([centre, cosine, sine]), np.stack(turning(arm.axis[4])))


def _at(coefficients: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The x, y, z at angles (P, N) of coefficients (3, P, 3)."""
    c, s = np.cos(theta), np.sin(theta)
    constant, cosine, sine = coefficients[..., None]
    return tuple(constant[:, i] + cosine[:, i] * c + sine[:, i] * s for i in range(3))


def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


class Elbow(NamedTuple):
    """The planar arm: shoulder to axis 3 and axis 3 to wrist, as complex numbers in the plane at
    right angles to axis 2 at q = 0; `sideways` along axis 2; `forearm` is axis 4 in that plane."""

    upper: complex
    lower: complex
    sideways: float
    forearm: complex
    across: float

    @classmethod
    def of(cls, arm: Geometry) -> Elbow:
        """The reference direction of the plane is that of the upper arm."""
        e2 = arm.axis[1]
        link = arm.point[2] - arm.shoulder
        x = (link - (link @ e2) * e2) / np.linalg.norm(link - (link @ e2) * e2)
        y = np.cross(e2, x)

        def planar(v: np.ndarray) -> complex:
            return complex(v @ x, v @ y)

        return cls(
            planar(link),
            planar(arm.wrist - arm.point[2]),
            float((arm.wrist - arm.shoulder) @ e2),
            planar(arm.axis[3]),
            float(arm.axis[3] @ e2),
        )

    @property
    def straight(self) -> complex:
        """exp(i theta3) at which the arm is stretched."""
        turn = self.upper / self.lower
        return turn / abs(turn)

    def cosine(self, square: np.ndarray) -> np.ndarray:
        """cos of the angle between the two links, from the squared distance |p|^2."""
        a, b = abs(self.upper), abs(self.lower)
        return (square - self.sideways**2 - a**2 - b**2) / (2 * a * b)


def shoulder_slack(arm: Geometry, elbow: Elbow, p) -> tuple[np.ndarray, ...]:
    """Paden-Kahan 2 with e1.z = e1.p, e2.z = d, |z| = |p|: z = .. + beta e2 +- gamma e1 x e2.

    Returns h = e1.p, beta, gamma^2 (negative where axis 2 cannot carry the wrist that near axis 1).
    """
    e1, c = arm.axis[0], float(arm.axis[0] @ arm.axis[1])
    d, s2 = elbow.sideways, 1 - c**2
    h = _dot(e1, p)
    away = tuple(x - h * e for x, e in zip(p, e1))
    # |p|^2 - |z0|^2, from the distance to axis 1 so that nothing cancels close to the axis.
    gamma2 = (_dot(away, away) - (d - c * h) ** 2 / s2) / s2
    return h, (d - c * h) / s2, gamma2


def condition(arm: Geometry, ring: Circle, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """f of theta (P, N) on the branches (shoulder, elbow), (2, 2, P, N), and feasibility (P, N).

    f = (R1 R2 R3 e4) . g - e4 . e5 vanishes where a turn about axis 4 and one about axis 5 do the
    rest. With n = R1 e2 the plane's normal, R1 R2 R3 e4 = k n + A (p - d n) + B n x p.
    """
    elbow = Elbow.of(arm)
    e1, c = arm.axis[0], float(arm.axis[0] @ arm.axis[1])
    p, g = _at(ring.p, theta), _at(ring.g, theta)
    square = _dot(p, p)
    h, beta, gamma2 = shoulder_slack(arm, elbow, p)
    cos3 = elbow.cosine(square)
    sin3 = np.sqrt(np.maximum(1 - cos3**2, 0.0))
    # Just beyond an end of an arc counts as the end: what comes of it is verified in any case.
    feasible = (np.abs(cos3) < 1 + 1e-11) & (gamma2 > -1e-12)
    gamma = np.sqrt(np.maximum(gamma2, 0.0))
    across = _cross(e1, p)
    rho2 = np.maximum(_dot(across, across), 1e-300) / (1 - c**2)
    planar2 = np.maximum(square - elbow.sideways**2, 1e-300)
    moment, pg = _cross(p, g), _dot(p, g)
    first = elbow.straight * elbow.forearm * elbow.upper.conjugate()
    second = elbow.forearm * elbow.lower.conjugate()
    cos3 = np.clip(cos3, -1, 1)
    f = np.empty((2, 2, *theta.shape))
    for i, shoulder in enumerate((1, -1)):
        n = tuple(
            c * e + (beta * (x - h * e) - shoulder * gamma * y) / rho2
            for e, x, y in zip(e1, p, across)
        )
        ng, nm = _dot(n, g), _dot(n, moment)
        for j, sign in enumerate((1, -1)):
            a = (first.real * cos3 - sign * first.imag * sin3 + second.real) / planar2
            b = (first.imag * cos3 + sign * first.real * sin3 + second.imag) / planar2
            f[i, j] = elbow.across * ng + a * (pg - elbow.sideways * ng) + b * nm
    return f - arm.axis[3] @ arm.axis[4], feasible


def graded(arm: Geometry, ring: Circle, nodes: int) -> np.ndarray:
    """(P, N) sorted angles theta6: even ones, and ones that crowd towards every special place.

    Special are the ends of the feasible arcs, where a branch has the slope of a square root, and
    the nearest approaches to such an end, where it bends within a distance that can be tiny: the
    wrist point passing close to axis 1, the elbow almost stretched or folded.
    """
    elbow = Elbow.of(arm)
    p = _at(ring.p, np.broadcast_to(np.arange(8) * np.pi / 4, (ring.p.shape[1], 8)))
    order, centres = np.arange(-2, 3), []
    for slack in (1 - elbow.cosine(_dot(p, p)) ** 2, shoulder_slack(arm, elbow, p)[2]):
        coefficients = np.fft.fft(slack, axis=1)[:, order]
        centres += [_zeros(coefficients), _zeros(order * coefficients)]
    centre = np.concatenate(centres, axis=1)
    offsets = 10.0 ** np.arange(-13, -2.4, 0.25)
    offsets = np.concatenate([-offsets, [0.0], offsets])
    near = (centre[..., None] + offsets).reshape(len(centre), -1)
    even = np.broadcast_to(np.arange(nodes) * 2 * np.pi / nodes, (len(centre), nodes))
    return np.sort(np.concatenate([near % (2 * np.pi), even], axis=1), axis=1)


def _zeros(coefficients: np.ndarray) -> np.ndarray:
    """Real parts of the zeros of sum_k c_k exp(i k theta), k = -2..2, (P, 5) -> (P, 4)."""
    scale = np.abs(coefficients).max(axis=1, keepdims=True)
    c = coefficients / np.maximum(scale, 1e-300)
    companion = np.zeros((len(c), 4, 4), complex)
    companion[:, [1, 2, 3], [0, 1, 2]] = 1
    # Where the highest term is missing, its zeros lie at infinity and any angle will do.
    leading = np.where(np.abs(c[:, 4]) > 1e-12, c[:, 4], 1e-12)
    companion[:, :, 3] = -c[:, :4] / leading[:, None]
    return np.angle(np.linalg.eigvals(companion))


def scan(arm: Geometry, home: np.ndarray, poses: np.ndarray, nodes: int) -> tuple[np.ndarray, ...]:
    """Candidates: their pose (n,) and joint vectors (n, 6), from a scan of theta6."""
    ring = circle(arm, home, poses)
    theta = graded(arm, ring, nodes)
    # The circle is closed by a few nodes of the other end on either side.
    theta = np.concatenate([theta[:, -2:] - 2 * np.pi, theta, theta[:, :2] + 2 * np.pi], axis=1)
    f, feasible = condition(arm, ring, theta)
    f = np.where(feasible, f, np.nan)
    left, right = f[..., :-1], f[..., 1:]
    with np.errstate(invalid="ignore"):
        crossing = left * right <= 0
        # A root may hide where |f| is least without a change of sign, also at the end of an arc.
        size = np.abs(f)
        inner = size[..., 1:-1]
        before, after = size[..., :-2], size[..., 2:]
        dip = ~((before < inner) | (after < inner)) & np.isfinite(inner)
        # It cannot where the neighbours differ by far less than what is missing: rounding.
        rise = np.fmax(before, after) - inner
        dip &= inner < 100 * rise + 1e-13
        dip &= ~(left[..., :-1] * f[..., 1:-1] <= 0) & ~(f[..., 1:-1] * right[..., 1:] <= 0)
    i, j, who, node = np.nonzero(dip)
    low = np.where(np.isfinite(f[i, j, who, node]), theta[who, node], theta[who, node + 1])
    high = np.where(np.isfinite(f[i, j, who, node + 2]), theta[who, node + 2], theta[who, node + 1])
    found = [_brackets(arm, ring, i, j, who, low, high)]
    i, j, who, node = np.nonzero(crossing)
    found.append((i, j, who, theta[who, node], theta[who, node + 1]))
    i, j, who, low, high = (np.concatenate(parts) for parts in zip(*found))
    low = _bisect(arm, ring, i, j, who, low, high)
    return who, angles(arm, home, poses, ring, i, j, who, low)


def _values(arm, ring, i, j, who, theta) -> np.ndarray:
    """f at one angle of one branch of one pose each, (n,)."""
    f, _ = condition(arm, Circle(ring.p[:, who], ring.g[:, who]), theta[:, None])
    return f[i, j, np.arange(len(who)), 0]


def _brackets(arm, ring, i, j, who, low, high):
    """The halves of [low, high] about the least |f|, where that is near or beyond zero."""
    golden = (np.sqrt(5) - 1) / 2
    sign = np.sign(_values(arm, ring, i, j, who, low))
    a, b = low, high
    for _ in range(45):
        c, d = b - golden * (b - a), a + golden * (b - a)
        lower = sign * _values(arm, ring, i, j, who, c) < sign * _values(arm, ring, i, j, who, d)
        a, b = np.where(lower, a, c), np.where(lower, d, b)
    middle = (a + b) / 2
    near = sign * _values(arm, ring, i, j, who, middle) < 1e-7
    both = [(i[near], j[near], who[near], ends[near], middle[near]) for ends in (low, high)]
    return tuple(np.concatenate(parts) for parts in zip(*both))


def _bisect(arm, ring, i, j, who, low, high) -> np.ndarray:
    """The root of f between low and high; high itself where there is no change of sign."""
    sign = np.sign(_values(arm, ring, i, j, who, low))
    for _ in range(52):
        middle = (low + high) / 2
        same = sign * _values(arm, ring, i, j, who, middle) > 0
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return high


def angles(arm, home, poses, ring, i, j, who, theta6) -> np.ndarray:
    """All six angles (n, 6) from theta6 (n,), shoulder and elbow branches i, j of poses[who]."""
    elbow = Elbow.of(arm)
    e1, e2 = arm.axis[0], arm.axis[1]
    p = np.stack(_at(ring.p[:, who], theta6[:, None]), -1)[:, 0]
    cos3 = np.clip(elbow.cosine((p * p).sum(1)), -1, 1)
    sign, shoulder = np.where(j == 0, 1.0, -1.0), np.where(i == 0, 1.0, -1.0)
    q = np.zeros((len(who), 6))
    q[:, 2] = sign * np.arccos(cos3) + np.angle(elbow.straight)
    third = rodrigues(e2, q[:, 2])
    wrist = third @ (arm.wrist - arm.point[2]) + arm.point[2] - arm.shoulder
    h, beta, gamma2 = shoulder_slack(arm, elbow, p.T)
    c = e1 @ e2
    alpha = (h - c * elbow.sideways) / (1 - c**2)
    gamma = shoulder * np.sqrt(np.maximum(gamma2, 0.0))
    z = np.outer(alpha, e1) + np.outer(beta, e2) + np.outer(gamma, np.cross(e1, e2))
    q[:, 0], q[:, 1] = turn_between(e1, z, p), turn_between(e2, wrist, z)
    carried = rodrigues(e1, q[:, 0]) @ rodrigues(e2, q[:, 1]) @ third
    motion = (poses @ np.linalg.inv(home))[who, :3, :3]
    left = np.swapaxes(carried, 1, 2) @ motion @ rodrigues(arm.axis[5], -theta6)
    e4, e5 = arm.axis[3], arm.axis[4]
    q[:, 3] = turn_between(e4, np.broadcast_to(e5, p.shape), left @ e5)
    left = rodrigues(e4, -q[:, 3]) @ left
    helper = np.cross(e5, np.roll(e5, 1) + np.array([0.3, 0.5, 0.7]))
    q[:, 4] = turn_between(e5, np.broadcast_to(helper, p.shape), left @ helper)
    q[:, 5] = theta6
    return q


def turn_between(axis: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Paden-Kahan 1: the angle about axis (3,) from a to b, (n, 3) each, radians."""
    # Projected first: close to the axis the difference of two products would be all rounding.
    a, b = a - np.outer(a @ axis, axis), b - np.outer(b @ axis, axis)
    return np.arctan2(np.cross(a, b) @ axis, (a * b).sum(axis=1))
