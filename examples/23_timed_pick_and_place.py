"""The paper's pick-and-place as one timed trajectory, executed by a simulated Niryo One.

You learn: how a plan of steps gets times, within the speeds and accelerations of the joints, with
vertical lines of the tool and no halt but where the gripper acts; how it is held against the arm's
own shape and the table; what a robot makes of its times. Given a path, `main` draws the figure of
docs/hardware.md. Needs the extra `robot`.

Expected output:

    12.14 s, of which the arm rests 2.00 s; through the ends of steps 2, 5, 6, 9 without a halt
    at most 44 % of a velocity and 100 % of an acceleration limit
    on the four vertical lines the tool is off by less than a nanometre
    least clearance: 2.9 mm, of tool and table, in step 3
    the object is at (148.0, 148.0) mm
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

import niryo_jax as nj
from niryo_jax import collision, motion, studies
from niryo_jax.figures import save
from niryo_jax.hardware import NiryoArm, SimulatedNiryo
from niryo_jax.hardware.pick_and_place import OBJECT_START, plan


class Result(NamedTuple):
    timed: studies.TimedPlan
    off: float
    clearance: float
    position: np.ndarray


def main(picture: Path | None = None, time_scale: float = 50.0) -> Result:
    jax.config.update("jax_enable_x64", True)
    robot, limits = nj.robots.niryo_one(), motion.niryo_limits("niryo_one")

    # 1. Ten steps, solved; then timed, at 70 or 30 % of the speeds as each step has it.
    timed = studies.timed_plan(plan(robot), limits, dwell=1.0)
    rests = sum(step.end - step.begin for step in timed.steps if step.way == "rest")
    passed = [str(i) for i, step in enumerate(timed.steps, start=1) if not step.rests]
    print(
        f"{timed.duration:.2f} s, of which the arm rests {rests:.2f} s; through the ends of steps "
        f"{', '.join(passed)} without a halt"
    )
    found = timed.trajectory
    shares = (
        np.max(np.abs(found.velocity) / limits.velocity),
        np.max(np.abs(found.acceleration) / limits.acceleration),
    )
    print(
        f"at most {100 * shares[0]:.0f} % of a velocity and {100 * shares[1]:.0f} % of an "
        "acceleration limit"
    )

    # 2. The lines.
    tool = np.asarray(nj.forward_kinematics(robot, found.q))[:, :3, 3]
    lines = [step for step in timed.steps if step.way == "line"]
    off = max(
        float(np.max(np.abs(tool[step.first : step.last + 1, :2] - tool[step.last, :2])))
        for step in lines
    )
    less = "less than a nanometre" if off < 1e-9 else f"{1e9 * off:.1f} nm"
    print(f"on the four vertical lines the tool is off by {less}")

    # 3. Nothing may be hit, along the trajectory and between the stops that a robot is sent to.
    model = collision.shipped(robot, "gripper_1")
    check = collision.CollisionCheck(model, collision.World.table(0.0))
    clear = studies.check_timed(timed, check)
    least, pair = clear.clearance[clear.tightest], " and ".join(clear.pairs[clear.tightest])
    print(f"least clearance: {1e3 * least:.1f} mm, of {pair}, in step {clear.tightest + 1}")

    # 4. A robot does it; one that is sped up need not wait for the times.
    with SimulatedNiryo(time_scale=time_scale) as simulated:
        simulated.place_object(OBJECT_START)
        with NiryoArm(simulated.address, robot=robot) as arm:
            arm.calibrate()
            arm.use_tool("gripper_1")
            arm.release()
            studies.execute_timed(timed, arm, keep_time=time_scale == 1.0)
        position = simulated.object_position
    assert position is not None
    print(f"the object is at ({1e3 * position[0]:.1f}, {1e3 * position[1]:.1f}) mm")

    if picture is not None:
        save(studies.timed_figure(timed, check), picture)
    return Result(timed, off, float(least), position)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
