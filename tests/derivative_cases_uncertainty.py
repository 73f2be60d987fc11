"""How the functions of uncertainty are differentiated."""

from __future__ import annotations

import functools
from typing import Any

import jax
import numpy as np
from derivative_cases_arms import FAR, GEOMETRY, NIRYO, OF_SMALL, Q2, SPHERICAL, Q, built, pose_of
from derivatives import Case, Kind, NoDerivative

import niryo_jax as nj
from niryo_jax import uncertainty as un

SPREAD2 = np.array([[2.0, 0.5], [0.5, 1.0]])
SPREAD6 = np.diag(np.arange(1.0, 7.0)) + 0.3
SPREAD3 = np.array([[2.0, 0.3, 0.1], [0.3, 1.0, -0.2], [0.1, -0.2, 0.5]])
ROUND = NoDerivative((np.eye(3),), "0 of the directions")
FLAT = NoDerivative((np.diag([1.0, 0.0, 0.0]),), "0 of the axis that is 0")
KEY = jax.random.key(3)
OTHER_DRAWS = np.inf
"""A key draws other numbers in float32."""
SIZES = np.array([0.01, 0.02, 0.03, 0.01, 0.02, 0.03])


def _propagated(q: Any, covariance: Any) -> un.Propagated:
    return un.propagate(NIRYO, q, covariance)


def _propagate(s: Any, m: Any, q: Any, covariance: Any, mean: Any) -> Any:
    found = un.propagate(built(s, m), q, covariance, mean)
    return found.covariance, found.position_covariance, found.mean_shift


def _noise(matrix: Any, width: Any, offset: Any, share: Any, play: Any) -> un.Noise:
    """Of everything at once, for one set of parameters."""
    parts = un.Gaussian(matrix), un.Uniform(width), un.Bias(offset), un.GearRatio(share, share)
    return sum((un.Backlash(play), un.EncoderSteps(0.3)), un.Combined(parts))


def _of_noise(what: str, *x: Any) -> Any:
    *parameters, q = x
    function = getattr(_noise(*parameters), what)
    return function(KEY, q, 4) if what == "sample" else function(q)


def _trials(matrix: Any, q: Any) -> un.MonteCarlo:
    return un.monte_carlo(NIRYO, q, un.Gaussian(1e-4 * matrix), KEY, 16)


def _compared(matrix: Any, q: Any) -> Any:
    found = un.compare(un.propagate(NIRYO, q, 1e-4 * matrix), _trials(matrix, q))
    return found.rms_ratio, found.half_axes_ratio, found.covariance_difference


def _ellipsoid(found: Any) -> Any:
    return found.half_axes, found.directions


ONE_MATRIX: dict[str, Kind] = {"matrix": "symmetric", "q": "free"}
PARAMETERS: dict[str, Kind] = {
    "matrix": "symmetric", "half_width": "free", "offset": "free", "share": "free", "play": "free",
    "q": "free",
}  # fmt: skip
NO_ERROR = NoDerivative((Q, np.zeros((6, 6))), "0")
BY_SPREAD: dict[str, Kind] = {"q": "free", "covariance": "symmetric"}
POSTURE = {"a posture": (Q, SPREAD6)}

UNCERTAINTY = [
    Case(
        "uncertainty.propagate",
        _propagate,
        GEOMETRY | {"q": "free", "covariance": "symmetric", "mean": "free"},
        {"a posture": (Q2, SPREAD2, Q2), "no error": (Q2, np.zeros((2, 2)), np.zeros(2))},
        shared=OF_SMALL,
        tier="heavy",
    ),
    Case(
        "uncertainty.Propagated.rms",
        lambda *x: _propagated(*x).rms,
        BY_SPREAD,
        POSTURE,
        {"no error": NO_ERROR},
        tier="slow",
    ),
    Case(
        "uncertainty.Propagated.ellipsoid",
        lambda *x: _ellipsoid(_propagated(*x).ellipsoid(0.9)),
        BY_SPREAD,
        POSTURE,
        {"no error": NO_ERROR},
        single=2e-2,
        tier="slow",
    ),
    Case(
        "uncertainty.sensitivity",
        lambda q, s: (lambda found: (found.position, found.rotation))(un.sensitivity(NIRYO, q, s)),
        {"q": "free", "sigma": "free"},
        {"a posture": (Q, SIZES)},
        {"an axis through the tool": NoDerivative((np.zeros(6), SIZES), "0 of that joint")},
        tier="heavy",
    ),
    *(
        Case(
            f"uncertainty.Sensitivity.{name}",
            lambda q, name=name: getattr(un.sensitivity(NIRYO, q), name),
            {"q": "free"},
            {"a posture": (Q,)},
            single=2e-3,
            tier="slow",
        )
        for name in ("millimetres", "milliradians")
    ),
    Case(
        "uncertainty.least_sensitive",
        lambda pose: un.least_sensitive(
            SPHERICAL, nj.inverse_kinematics(SPHERICAL, pose), SPREAD6.astype(pose.dtype)
        )[0],
        {"pose": "motion"},
        {"a posture": (pose_of(SPHERICAL, Q),)},
        {"out of reach": NoDerivative((FAR,), "0")},
        jitted=False,
        turns=True,
        single=2e-2,
        tier="heavy",
    ),
    Case(
        "uncertainty.position_ellipsoid",
        lambda c: _ellipsoid(un.position_ellipsoid(c, 0.9)),
        {"covariance": "symmetric"},
        {"three axes": (SPREAD3,)},
        {"a sphere": ROUND, "a line": FLAT, "a point": NoDerivative((np.zeros((3, 3)),), "0")},
    ),
    Case(
        "uncertainty.Gaussian.independent",
        lambda sigma: un.Gaussian.independent(sigma[0]).matrix[None],
        {"sigma": "free"},
        {"some": (SIZES,), "none": (np.zeros(6),)},
    ),
    *(
        Case(
            f"uncertainty.Noise.{what}",
            functools.partial(_of_noise, what),
            PARAMETERS,
            {"a posture": (Q,)},
            shared=(SPREAD6, *(SIZES for _ in range(4))),
        )
        for what in ("mean", "covariance")
    ),
    Case(
        "uncertainty.Noise.sample",
        functools.partial(_of_noise, "sample"),
        PARAMETERS,
        {"a posture": (Q,)},
        shared=(SPREAD6, *(SIZES for _ in range(4))),
        single=OTHER_DRAWS,
    ),
    Case(
        "uncertainty.monte_carlo",
        lambda *x: (lambda y: (y.mean, y.covariance, y.rms, y.mean_norm, y.percentiles))(
            _trials(*x)
        ),
        ONE_MATRIX,
        {"a posture": (Q,)},
        shared=(SPREAD6,),
        single=OTHER_DRAWS,
        tier="slow",
    ),
    *(
        Case(
            f"uncertainty.MonteCarlo.{name}",
            lambda *x, name=name: getattr(_trials(*x), name),
            ONE_MATRIX,
            {"a posture": (Q,)},
            shared=(SPREAD6,),
            single=OTHER_DRAWS,
            tier="slow",
        )
        for name in ("position_covariance", "mean_shift")
    ),
    Case(
        "uncertainty.MonteCarlo.ellipsoid",
        lambda *x: _ellipsoid(_trials(*x).ellipsoid()),
        ONE_MATRIX,
        {"a posture": (Q,)},
        shared=(SPREAD6,),
        single=OTHER_DRAWS,
        tier="slow",
    ),
    Case(
        "uncertainty.compare",
        _compared,
        ONE_MATRIX,
        {"a posture": (Q,)},
        shared=(SPREAD6,),
        single=OTHER_DRAWS,
        tier="slow",
    ),
]
