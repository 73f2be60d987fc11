"""A figure of what errors of the joints make of the position of the tool."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import jax
import numpy as np
from jax.typing import ArrayLike

from niryo_jax.chain import forward_kinematics
from niryo_jax.extras import need
from niryo_jax.figures import BLUE, GREY, INK, RED, STYLE
from niryo_jax.lanes.batching import as_floating, check_shape
from niryo_jax.robot import Robot, check_is_robot
from niryo_jax.uncertainty.noise import Noise, check_noise
from niryo_jax.uncertainty.normal import radius_of
from niryo_jax.uncertainty.propagation import propagate, sensitivity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_CLOUD = 3000
"""Draws that are shown."""

_SECTIONS = ((0, 1), (0, 2))


def error_figure(
    robot: Robot,
    q: ArrayLike,
    noise: Noise,
    key: ArrayLike,
    *,
    probability: float = 0.95,
    title: str | None = None,
) -> Figure:
    """Where the tool goes by errors of the joints, seen along z and along y, and whose they are.

    The two views show draws of the position error in millimetres, in the axes of the space frame,
    and the outlines of the propagated ellipsoid: of one standard deviation and of a probability.
    The bars are the errors of one standard deviation of each joint alone, in mm and in mrad.

    Args:
        robot: the arm.
        q: (n,) joint vector.
        noise: the model of the errors.
        key: of `jax.random`, for the draws that are shown.
        probability: of the error being inside the outer ellipsoid.
        title: above it all; the robot's name unless given.

    Raises:
        ImportError: matplotlib is not installed.
        ValueError, TypeError: as `monte_carlo`; a probability that is not between 0 and 1.
    """
    check_is_robot(robot)
    q = as_floating("q", q)
    check_shape("q", q, (robot.joints,))
    if q.ndim != 1:
        raise ValueError(f"q: expected shape ({robot.joints},), got {q.shape}")
    check_noise("noise", noise)
    radius = radius_of(probability)
    drawn = forward_kinematics(robot, q + noise.sample(key, q, _CLOUD))
    nominal = forward_kinematics(robot, q)
    cloud = 1e3 * np.asarray(drawn[:, :3, 3] - nominal[:3, 3])
    covariance = noise.covariance(q)
    found = propagate(robot, q, covariance, noise.mean(q))
    position = 1e6 * np.asarray(found.position_covariance)
    shift = 1e3 * np.asarray(found.mean_shift)
    alone = sensitivity(robot, q, jax.numpy.sqrt(jax.numpy.diagonal(covariance)))
    with need("matplotlib").rc_context(STYLE):
        figure: Figure = need("matplotlib.figure").Figure(figsize=(7.2, 2.6), layout="compressed")
        *views, bars = figure.subplots(1, 3, width_ratios=[1, 1, 1.2])
        reach = 1.3 * max(float(np.max(np.abs(cloud))), 1e-9)
        for axes, section in zip(views, _SECTIONS):
            _draw_section(axes, section, cloud, position, shift, radius, probability)
            axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
        # Above the points, in the corner that is always empty of an ellipsoid's box or nearly so.
        views[0].legend(loc="upper left", frameon=False, fontsize=6, handlelength=1.2)
        _draw_bars(bars, robot, np.asarray(alone.millimetres), np.asarray(alone.milliradians))
        rms = 1e3 * float(found.rms)
        figure.suptitle(f"{robot.name if title is None else title}: {rms:.2f} mm rms")
    return figure


def _draw_section(
    axes: Axes,
    section: tuple[int, int],
    cloud: np.ndarray,
    covariance: np.ndarray,
    shift: np.ndarray,
    radius: float,
    probability: float,
) -> None:
    """The draws and the outlines of the ellipsoids, seen along the third axis."""
    pair = list(section)
    points = cloud[:, pair].T
    # As pixels, for thousands of points make a heavy page.
    axes.plot(*points, ".", color=GREY, markersize=1.2, alpha=0.5, rasterized=True, zorder=1)
    values, vectors = np.linalg.eigh(covariance[np.ix_(pair, pair)])
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    outline = vectors @ (np.sqrt(np.maximum(values, 0.0))[:, None] * circle)
    looks: tuple[tuple[float, str, str], ...] = (
        (1.0, BLUE, "one standard deviation"),
        (radius, RED, f"{100 * probability:g} % ellipsoid"),
    )
    for size, colour, label in looks:
        curve = shift[pair, None] + size * outline
        axes.plot(*curve, color=colour, linewidth=1.0, label=label, zorder=2)
    across, up = ("xyz"[i] for i in section)
    axes.set(xlabel=f"{across} (mm)", ylabel=f"{up} (mm)", aspect="equal")
    axes.axhline(0.0, color=INK, linewidth=0.3, zorder=0)
    axes.axvline(0.0, color=INK, linewidth=0.3, zorder=0)


def _draw_bars(axes: Axes, robot: Robot, position: np.ndarray, rotation: np.ndarray) -> None:
    """What each joint alone does, with a scale for each unit."""
    place = np.arange(robot.joints)
    other: Any = axes.twinx()
    one = axes.bar(place - 0.2, position, 0.38, color=BLUE)
    two = other.bar(place + 0.2, rotation, 0.38, color=GREY)
    axes.set_ylabel("tool moves (mm)")
    other.set_ylabel("tool turns (mrad)")
    axes.set_xticks(place, [str(i + 1) for i in place])
    axes.set_xlabel("joint, one standard deviation each")
    for scale, values in ((axes, position), (other, rotation)):
        scale.set_ylim(0.0, 1.3 * max(float(np.max(values)), 1e-9))
        scale.tick_params(labelsize=7, width=0.6)
    axes.legend([one, two], ["mm", "mrad"], loc="upper right", ncols=2, frameon=False)
