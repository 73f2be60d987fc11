"""The paper's pick-and-place: five poses solved in one batch, executed by a simulated Niryo One.

You learn: how a plan is made from poses, how `NiryoArm` drives a robot through pyniryo, and that
the simulated robot is driven exactly as the real one. Put your robot's address in place of
`simulated.address` to see it move. Needs the extra `robot`.

Expected output, with one line for each of the ten steps:

    Starting position                error 0.000 mm
    ...
    Return to the start              error 0.000 mm
    the object is at (148.0, 148.0) mm
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import numpy as np

import niryo_jax as nj
from niryo_jax.hardware import NiryoArm, SimulatedNiryo
from niryo_jax.hardware.pick_and_place import OBJECT_START, StepRecord, execute, plan


class Result(NamedTuple):
    records: tuple[StepRecord, ...]
    position: np.ndarray


def main(time_scale: float = 20.0) -> Result:
    jax.config.update("jax_enable_x64", True)
    robot = nj.robots.niryo_one()

    # Ten steps with five distinct poses; one of them is printed with three decimals and so is not
    # quite a rigid motion. Each step takes the solution nearest to where the arm is by then.
    planned = plan(robot)

    with SimulatedNiryo(time_scale=time_scale) as simulated:
        simulated.place_object(OBJECT_START)
        with NiryoArm(simulated.address, robot=robot) as arm:
            arm.calibrate()
            arm.use_tool("gripper_1")
            arm.release()
            records = execute(planned, arm, _report)
        position = simulated.object_position
    assert position is not None
    print(f"the object is at ({1e3 * position[0]:.1f}, {1e3 * position[1]:.1f}) mm")
    return Result(records, position)


def _report(record: StepRecord) -> None:
    error = record.position_error
    shown = "" if error is None else f"error {1e3 * error:.3f} mm"
    print(f"{record.planned.step.title:32} {shown}")


if __name__ == "__main__":
    main()
