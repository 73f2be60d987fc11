"""Draw general-6r.svg: the polynomial of two poses of general arms, its roots and its arcs.

Run by hand from the root of the repository, with matplotlib installed:

    python docs/theory/general_6r_figure.py
"""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt

import niryo_jax as nj
from niryo_jax.ik.general.isolation import ARCS, FAR, START, isolated, refined
from niryo_jax.ik.general.polynomial import equations_and_polynomial
from niryo_jax.ik.trig_polynomial import DEGREE
from niryo_jax.specialise import traced_geometry
from niryo_jax.structure.closure import closure_numbers, eliminations

SEED = 20261127


def calibrated() -> nj.Robot:
    """A UR16e whose axes are off by a millimetre and a milliradian."""
    rng = np.random.default_rng(SEED)
    nominal = nj.robots.load("ur16e")
    w, v = np.asarray(nominal.screws)[:, :3], np.asarray(nominal.screws)[:, 3:]
    points = np.cross(w, v) + 1e-3 * rng.standard_normal((6, 3))
    return nj.Robot.from_axes(w + 1e-3 * rng.standard_normal((6, 3)), points, nominal.home)


def draw(axes: plt.Axes, robot: nj.Robot, pose: np.ndarray, what: str) -> None:
    """g on a scale that shows its signs and its size, its roots, and where arcs meet."""
    screws = np.asarray(robot.screws)
    numbers = closure_numbers(screws, eliminations(screws)[0])
    geometry = traced_geometry(robot, np.dtype(float))
    _, g = equations_and_polynomial(numbers, geometry, jnp.asarray(pose)[None], jnp.ones(1, bool))
    roots = isolated(g, FAR)
    c = np.asarray(g.coefficients)[:, 0]

    def value(t: np.ndarray) -> np.ndarray:
        k = np.arange(1, DEGREE + 1)[:, None]
        waves = c[1 : DEGREE + 1, None] * np.cos(k * t) - c[DEGREE + 1 :, None] * np.sin(k * t)
        return c[0] + 2 * waves.sum(axis=0)

    t = np.linspace(0, 2 * np.pi, 4001)
    shown = np.arcsinh(value(t) / 1e-7)
    axes.plot(t, shown, color="#0072b2", linewidth=1.3)
    number = int(roots.number)
    angles = np.asarray(refined(g, roots.owner[:number], roots.near[:number]))
    axes.plot(angles % (2 * np.pi), np.zeros_like(angles), "o", color="#d55e00", markersize=5)
    axes.axhline(0, color="0.6", linewidth=0.8)
    for end in START + 2 * np.pi * np.arange(ARCS) / ARCS:
        axes.axvline(end, color="0.88", linewidth=0.6, zorder=0)
    axes.set_title(f"{what}: {len(angles)} roots", fontsize=9)
    axes.set_yticks([])
    axes.set_xlim(0, 2 * np.pi)
    axes.set_xlabel("angle of the kept joint (rad)", fontsize=9)


def main() -> None:
    """Draw and write the figure."""
    jax.config.update("jax_enable_x64", True)
    mpl.rcParams["svg.hashsalt"] = "niryo_jax"
    robot = calibrated()
    rng = np.random.default_rng(SEED)
    figure, both = plt.subplots(1, 2, figsize=(9, 2.8), layout="constrained")
    q = rng.uniform(-3, 3, 6)
    draw(both[0], robot, np.asarray(nj.forward_kinematics(robot, q)), "a calibrated UR16e")
    screws = rng.standard_normal((2, 6, 3))
    general = nj.Robot.from_axes(screws[0], 0.3 * screws[1], np.eye(4))
    draw(both[1], general, np.asarray(nj.forward_kinematics(general, q)), "axes at random")
    both[0].set_ylabel("arsinh of g", fontsize=9)
    figure.savefig(Path(__file__).with_name("general-6r.svg"), metadata={"Date": None})


if __name__ == "__main__":
    main()
