"""Draw complete-ik.svg: the condition f on its four branches, for two poses of the Niryo One.

Run by hand from the root of the repository, with matplotlib installed:

    python docs/theory/complete_ik_figure.py
"""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt

import niryo_jax as nj
from niryo_jax import lanes
from niryo_jax.ik.offset_wrist.parameters import OffsetWristParameters, parameters_from
from niryo_jax.ik.offset_wrist.posture import posture
from niryo_jax.ik.offset_wrist.remainder_bound import Rounding, proves, remainder_bound
from niryo_jax.ik.offset_wrist.wrist_circle import WristCircle, wrist_circle
from niryo_jax.lanes import Lane
from niryo_jax.structure.offset_wrist import arm_numbers

SEED, POSES = 20261122, 1024
CHOSEN = ((275, 16, "the whole circle in reach"), (15, 8, "an arc in reach, cut by the edge"))
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#aa3377")
INTERVALS = 16
PLUS, MINUS = "+", "\N{MINUS SIGN}"
POINTS = 601


def arm_of(robot: nj.Robot) -> OffsetWristParameters:
    """The numbers of an arm, as lanes."""
    numbers = arm_numbers(np.asarray(robot.screws), np.asarray(robot.home)[:3, 3], np)
    known = robot.offset_wrist
    return parameters_from(
        known, [jnp.asarray(x) for x, k in zip(numbers, known.entries) if k is None]
    )


def condition(
    arm: OffsetWristParameters, circle: WristCircle, t: np.ndarray, elbow: float, shoulder: float
) -> tuple[np.ndarray, np.ndarray]:
    """f on one branch, and the bound m of its remainder within half an interval of t."""
    sin_cos = Lane(jnp.sin(t)), Lane(jnp.cos(t))
    found = posture(arm, circle, sin_cos, elbow, shoulder)
    f = found.dot - arm.wrist_angle
    bound = remainder_bound(arm, circle, found, sin_cos, np.pi / 2 / INTERVALS).remainder
    return tuple(np.broadcast_to(np.asarray(x.array), t.shape) for x in (f, bound))


def draw(
    axes: plt.Axes, arm: OffsetWristParameters, pose: np.ndarray, expected: int, what: str
) -> None:
    """One pose: the four branches, their roots, and the intervals that must be halved."""
    circle = wrist_circle(arm, lanes.unpack(jnp.asarray(pose), 2))
    t = np.linspace(-np.pi / 2, np.pi / 2, POINTS)
    nodes = np.linspace(-np.pi / 2, np.pi / 2, INTERVALS + 1)
    middles = 0.5 * (nodes[:-1] + nodes[1:])
    settled, roots = np.ones(len(nodes) - 1, bool), 0
    branches = [(elbow, shoulder) for elbow in (1.0, -1.0) for shoulder in (1.0, -1.0)]
    for (elbow, shoulder), colour in zip(branches, COLOURS):
        f = condition(arm, circle, t, elbow, shoulder)[0]
        f_nodes = condition(arm, circle, nodes, elbow, shoulder)[0]
        bound = condition(arm, circle, middles, elbow, shoulder)[1]
        sure, _ = proves(bound, nodes[1] - nodes[0], f_nodes[:-1], f_nodes[1:], Rounding(0.0, 0.0))
        settled &= np.asarray(sure)
        signs = " ".join(PLUS if sign > 0 else MINUS for sign in (elbow, shoulder))
        axes.plot(t, f, color=colour, linewidth=1.3, label=signs)
        before = np.flatnonzero((f[:-1] > 0) != (f[1:] > 0))
        at = t[before] - f[before] * (t[1] - t[0]) / (f[before + 1] - f[before])
        axes.plot(at, 0 * at, "o", color=colour, markersize=4.5, markeredgecolor="white", zorder=3)
        roots += len(at)
    if roots != expected:
        raise ValueError(f"expected {expected} roots, got {roots}")
    for low, high, done in zip(nodes[:-1], nodes[1:], settled):
        if not done:
            axes.axvspan(low, high, color="#e6e6e6", linewidth=0, zorder=0)
    axes.axhline(0.0, color="#444444", linewidth=0.8)
    axes.set_title(f"{roots} solutions: {what}", fontsize=10)
    axes.set_xlim(nodes[0], nodes[-1])
    axes.set_xticks([-np.pi / 2, -np.pi / 4, 0, np.pi / 4, np.pi / 2])
    axes.set_xticklabels([MINUS + "π/2", MINUS + "π/4", "0", "π/4", "π/2"])
    axes.set_xlabel("t")


def main() -> None:
    """Draw and save the figure."""
    jax.config.update("jax_enable_x64", True)
    mpl.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "complete-ik", "font.size": 9})
    robot = nj.robots.niryo_one()
    arm = arm_of(robot)
    rng = np.random.default_rng(SEED)
    q = rng.uniform(np.asarray(robot.lower), np.asarray(robot.upper), (POSES, 6))
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    for panel, (row, expected, what) in zip(axes, CHOSEN):
        draw(panel, arm, np.asarray(nj.forward_kinematics(robot, q[row])), expected, what)
    axes[0].set_ylabel("f")
    axes[1].legend(title="elbow, shoulder", fontsize=8, title_fontsize=8, loc="lower left")
    # A white card, so that the figure reads the same on a dark page.
    path = Path(__file__).with_name("complete-ik.svg")
    figure.savefig(path, facecolor="white", metadata={"Date": None})


if __name__ == "__main__":
    main()
