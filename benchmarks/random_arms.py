"""Random arms of every family: joints that share a direction or a point, and those that do not."""

from __future__ import annotations

import numpy as np

import niryo_jax as nj

FAMILIES = {
    "shoulder with parallel axes 2 and 3": "Rpqwww",
    "shoulder with parallel axes 1 and 2": "ppRwww",
    "shoulder with axes 2 and 3 that meet": "Rmmwww",
    "shoulder with axes 1 and 2 that meet": "mmRwww",
    "shoulder in general position": "RRRwww",
    "spherical base, shoulder in general position": "wwwRRR",
    "gantry": "Ppqwww",
    "slide before axes that meet": "Pmmwww",
    "slide behind parallel axes": "ppPwww",
    "slide behind axes that meet": "mmPwww",
    "cylindrical": "RPPwww",
    "two slides first": "PPRwww",
    "three slides": "PPPwww",
    "slide across axis 2": "Rpswww",
    "slide across axis 3": "Rspwww",
    "slides about an axis": "Ppswww",
    "three parallel axes": "Rpqpww",
    "three parallel axes behind a slide": "Pppqww",
    "three parallel axes, from the other end": "wwppqR",
    "SCARA": "ppaq",
    "slide first": "appp",
    "two turns and two slides": "RPRP",
    "cylindrical with a roll": "RPPR",
    "planar arm on a base, with a roll": "RpqpR",
    "planar arm on a base": "Rppq",
    "planar arm with a roll": "pqpR",
    "two parallel axes between others": "RpqR",
    "three joints, the last two parallel": "Rpq",
    "three joints, the first two parallel": "ppR",
}
"""Arms with a closed form, six joints at most.

R is a revolute joint anywhere, P a prismatic one; p a revolute joint along a common direction, q
one that points the other way; m a revolute joint through a common point, n one that is parallel
to the common direction as well; w one through another point; s a prismatic joint at right angles to
the common direction, a one along it.
"""

OTHERS = {
    "offset wrist": "mnpwwR",
    "offset wrist, axis 3 the other way": "mnqwwR",
    "general": "RRRRRR",
    "general with a spherical base": "wwRRRR",
    "seven joints, spherical shoulder and wrist": "mmmRwww",
    "seven joints, parallel axes 2 and 3": "RpqRwww",
    "seven joints, three parallel axes": "RRpqpww",
    "seven joints, offset wrist": "mnpwwRR",
    "seven joints in general position": "RRRRRRR",
}
"""Arms without a closed form, or with more joints, in the same letters."""


class _Maker:
    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.direction = _unit(rng)
        self.shared = {"m": rng.standard_normal(3), "w": rng.standard_normal(3)}

    def joint(self, letter: str) -> np.ndarray:
        """The screw (6,) of a joint."""
        rng, common = self.rng, self.direction
        if letter in "mwn":
            direction = common if letter == "n" else _unit(rng)
            return _axis(direction, self.shared["m" if letter == "n" else letter])
        if letter in "Rpq":
            direction = {"R": _unit(rng), "p": common, "q": -common}[letter]
            return _axis(direction, rng.standard_normal(3))
        across = np.cross(common, _unit(rng))
        across = across / np.linalg.norm(across)
        direction = {"P": _unit(rng), "s": across, "a": common}[letter]
        return np.concatenate([np.zeros(3), direction])


def _unit(rng: np.random.Generator) -> np.ndarray:
    v = rng.standard_normal(3)
    return v / np.linalg.norm(v)


def _axis(direction: np.ndarray, point: np.ndarray) -> np.ndarray:
    return np.concatenate([direction, np.cross(point, direction)])


def arm(name: str, rng: np.random.Generator) -> nj.Robot:
    """A random arm of a family."""
    maker = _Maker(rng)
    screws = np.stack([maker.joint(letter) for letter in (FAMILIES | OTHERS)[name]])
    home = np.array(nj.se3.exp(rng.standard_normal(6)))
    return nj.Robot.from_screws(screws, home, name=name)
