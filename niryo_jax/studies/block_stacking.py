"""Blocks stacked by a worn arm, before and after it is calibrated."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from niryo_jax.arguments import check_count
from niryo_jax.calibration import Calibration, fit, informative
from niryo_jax.chain import forward_kinematics
from niryo_jax.hardware import NiryoArm, SimulatedNiryo, Wear, visit
from niryo_jax.hardware.pick_and_place import Plan, execute, plan
from niryo_jax.hardware.stacking import TOOL, Layout, Placed, judged, steps_for
from niryo_jax.lie import so3
from niryo_jax.robot import Robot
from niryo_jax.robots import NIRYO_ONE, NiryoModel

Vector = NDArray[np.float64]

PARAMETERS = "offsets", "gears"
"""What is estimated of a worn arm."""

SIGMA = 1e-4, 5e-4
"""Standard deviations of the instrument: metres and radians."""

_CANDIDATES, _EDGE, _ABOVE_TABLE = 400, 0.05, 0.1


@dataclasses.dataclass(frozen=True)
class StackingStudy:
    """What became of the blocks.

    Attributes:
        wear: of the arm.
        before: the blocks, moved by the plan of the nominal arm.
        calibration: the arm as it was fitted to what was measured of it.
        after: the blocks, moved by the plan of the fitted arm.
    """

    wear: Wear
    before: tuple[Placed, ...]
    calibration: Calibration
    after: tuple[Placed, ...]


def typical_wear(seed: int) -> Wear:
    """A worn Niryo: zeros off by 0.01 rad (the report's sigma), gears by 0.5 %, a play of 1 mrad,
    and joints that come to rest within 0.3 mrad."""
    rng = np.random.default_rng(seed)
    offsets, gears = rng.normal(size=(2, 6)) * ((0.01,), (0.005,))
    return Wear(offsets, gears, play=1e-3, noise=3e-4, seed=seed)


def postures(robot: Robot, count: int) -> Vector:
    """(count, 6) joint vectors above the table that tell most of the parameters."""
    lower, upper = np.asarray(robot.lower) + _EDGE, np.asarray(robot.upper) - _EDGE
    q = np.random.default_rng(0).uniform(lower, upper, (_CANDIDATES, robot.joints))
    q = q[np.asarray(forward_kinematics(robot, q))[:, 2, 3] > _ABOVE_TABLE]
    return q[informative(robot, q, count, PARAMETERS, sigma=SIGMA)]


def instrument(simulated: SimulatedNiryo, seed: int) -> Callable[[], Vector]:
    """What sees the pose (4, 4) of a simulated arm's tool frame, with errors of `SIGMA`."""
    rng = np.random.default_rng([seed, 1])

    def look() -> Vector:
        pose = simulated.true_pose
        shift, turn = rng.normal(size=(2, 3)) * np.array(SIGMA)[:, None]
        pose[:3, 3] += shift
        pose[:3, :3] = pose[:3, :3] @ np.asarray(so3.exp(turn))
        return pose

    return look


def block_stacking(
    seed: int = 0,
    *,
    model: NiryoModel = NIRYO_ONE,
    layout: Layout | None = None,
    measurements: int = 30,
    time_scale: float = 1e4,
) -> StackingStudy:
    """Let a worn simulated arm move four blocks, calibrate it, and let it move them again.

    Args:
        seed: of the wear, of what the joints do at random, and of the instrument.
        model: the arm.
        layout: where the blocks are and belong.
        measurements: how many poses are measured for the calibration.
        time_scale: how many times faster than the robot the simulated arm moves.

    Raises:
        ValueError: fewer than two measurements, or more than 200; no seed.
        StepUnsolvable: the arm does not reach the layout; the message says where.
        PyniryoMissing: the extra `robot` is not installed.
    """
    check_count("measurements", measurements, 2, _CANDIDATES // 2)
    seed = check_count("seed", seed, 0, 2**31)
    chosen = Layout() if layout is None else layout
    robot, steps, wear = model.robot(), steps_for(chosen, model), typical_wear(seed)
    with (
        SimulatedNiryo(model, time_scale=time_scale, tool=TOOL, wear=wear) as simulated,
        NiryoArm(simulated.address, robot=robot) as arm,
    ):
        arm.calibrate()
        arm.use_tool(TOOL)

        def stacked(planned: Plan) -> tuple[Placed, ...]:
            arm.release()
            simulated.place_blocks(chosen.stacked, chosen.size)
            execute(planned, arm)
            return judged(chosen, simulated.blocks)

        before = stacked(plan(robot, steps))
        read, seen = visit(arm, postures(robot, measurements), instrument(simulated, seed))
        found = fit(robot, read, seen, PARAMETERS, sigma=SIGMA)
        after = stacked(plan(found.robot, steps, gears=found.gears))
    return StackingStudy(wear, before, found, after)
