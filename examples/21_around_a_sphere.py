"""A path around a sphere: clearance as a cost, first with optax, then least squares by optimistix.

You learn: that `collision.clearance` has a derivative, so that a path can be pushed out of an
obstacle by any optimiser; that the same path as least squares ends smoother after a fifth of the
steps; and to verify what comes out between its points too. Needs optax and optimistix
(`pip install "niryo_jax[research]"`). Given a path, `main` draws the figure of docs/research.md
(`pip install "niryo_jax[workspace]"`).

Expected output:

    straight in the joints: 27.4 mm inside the sphere
    by Adam, 200 steps: 35.8 mm clear
    by Levenberg-Marquardt, 41 steps: 19.7 mm clear, at 0.23 of the cost
    verified at 20,000 postures between: at least 19.7 mm
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import niryo_jax as nj
from niryo_jax import collision as co
from niryo_jax.extras import need
from niryo_jax.figures import BLUE, GREY, INK, RED, STYLE, save

START = np.deg2rad([-50.0, -30.0, -20.0, 0.0, -40.0, 0.0])
END = np.deg2rad([50.0, -30.0, -20.0, 0.0, -40.0, 0.0])
CENTRE, RADIUS = np.array([0.32, 0.0, 0.16]), 0.06
BETWEEN, MARGIN = 15, 0.02


class Result(NamedTuple):
    before: float
    adam: float
    squares: float
    verified: float
    ratio: float


def main(picture: Path | None = None) -> Result:
    optax, optx = need("optax", "research"), need("optimistix", "research")
    jax.config.update("jax_enable_x64", True)
    robot, model = nj.robots.niryo_one(), co.niryo_one("gripper_1")
    world = co.World.spheres([CENTRE], [RADIUS]) + co.World.table(-0.001)
    straight = START + np.linspace(0.0, 1.0, BETWEEN + 2)[1:-1, None] * (END - START)

    def whole(points: Any) -> jax.Array:
        """All joint vectors, with both ends, which stay where they are."""
        return jnp.concatenate([START[None], points, END[None]])

    def residuals(points: jax.Array, _: Any = None) -> tuple[jax.Array, jax.Array]:
        """How far it is from even, and what of the margin is missing at the points and halfway."""
        q = whole(points)
        rough = q[2:] - 2.0 * q[1:-1] + q[:-2]
        at = jnp.concatenate([q, 0.5 * (q[1:] + q[:-1])])
        return rough, 30.0 * jnp.maximum(MARGIN - co.clearance(robot, model, at, world), 0.0)

    def cost(points: jax.Array) -> jax.Array:
        return sum(jnp.sum(part**2) for part in residuals(points))

    def nearest(points: Any, samples: int = 1000) -> float:
        """The least clearance of the path through all points, straight in the joints between."""
        q, at = np.asarray(whole(points)), np.linspace(0, BETWEEN + 1, samples)
        dense = np.stack([np.interp(at, np.arange(len(q)), joint) for joint in q.T], axis=-1)
        return float(jnp.min(co.clearance(robot, model, dense, world)))

    before = nearest(straight)
    print(f"straight in the joints: {-1e3 * before:.1f} mm inside the sphere")
    # Lifted a little, because in the middle of a sphere every way out is as good.
    bent = straight + 0.2 * np.sin(np.linspace(0, np.pi, BETWEEN + 2))[1:-1, None] * [
        0,
        1,
        1,
        0,
        0,
        0,
    ]

    optimiser = optax.adam(optax.cosine_decay_schedule(0.005, 200))

    @jax.jit
    def descend(points: jax.Array) -> jax.Array:
        def step(carry: Any, _: None) -> Any:
            points, state = carry
            change, state = optimiser.update(jax.grad(cost)(points), state)
            return (optax.apply_updates(points, change), state), None

        return jax.lax.scan(step, (points, optimiser.init(points)), length=200)[0][0]

    by_adam = descend(jnp.asarray(bent))
    adam = nearest(by_adam)
    print(f"by Adam, 200 steps: {1e3 * adam:.1f} mm clear")

    found = optx.least_squares(
        residuals,
        optx.LevenbergMarquardt(1e-6, 1e-6),
        jnp.asarray(bent),
        max_steps=100,
        throw=False,
    )
    steps, squares = int(found.stats["num_steps"]), nearest(found.value)
    ratio = float(cost(found.value) / cost(by_adam))
    print(
        f"by Levenberg-Marquardt, {steps} steps: {1e3 * squares:.1f} mm clear, at {ratio:.2f} of "
        "the cost"
    )
    verified = nearest(found.value, 20_000)
    print(f"verified at 20,000 postures between: at least {1e3 * verified:.1f} mm")
    if picture is not None:
        _draw(picture, robot, [whole(points) for points in (straight, by_adam, found.value)])
    return Result(before, adam, squares, verified, ratio)


def _draw(picture: Path, robot: nj.Robot, paths: list[jax.Array]) -> None:
    """The tool's way past the sphere, from the side and from above."""
    figure_of, circle = need("matplotlib.figure").Figure, need("matplotlib.patches").Circle
    names, colours = ("straight in the joints", "Adam", "Levenberg-Marquardt"), (RED, INK, BLUE)
    with need("matplotlib").rc_context(STYLE):
        figure = figure_of(figsize=(5.6, 2.6), layout="constrained")
        for axes, (i, j) in zip(figure.subplots(1, 2), ((1, 2), (1, 0))):
            axes.add_patch(circle(CENTRE[[i, j]], RADIUS, color=GREY))
            for q, name, colour in zip(paths, names, colours):
                line = np.asarray(nj.forward_kinematics(robot, q))[:, :3, 3]
                axes.plot(line[:, i], line[:, j], ".-", color=colour, lw=1, ms=3, label=name)
            axes.set(aspect="equal", xlabel=f"{'xyz'[i]} [m]", ylabel=f"{'xyz'[j]} [m]")
        lines = figure.axes[0].get_lines()
        figure.legend(handles=lines, loc="outside upper center", ncols=3, frameon=False)
    save(figure, picture)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
