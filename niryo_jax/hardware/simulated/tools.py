"""Commands about tools, and those that pick and place with them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from niryo_jax.hardware.simulated.answers import (
    BOOLEANS,
    RobotRefused,
    choice,
    numbers,
    of_type,
)
from niryo_jax.hardware.simulated.arm import SimulatedArm, Vector
from niryo_jax.hardware.simulated.motion import Handlers, Motion
from niryo_jax.lie.rpy import pose_from_rpy

# How far above an object the robot stops on its way to it and back, metres.
_ABOVE = 0.05


class Tools:
    """The tool of a simulated arm, as the server of system 4 or 5 drives it."""

    def __init__(self, arm: SimulatedArm, motion: Motion, *, modern: bool) -> None:
        self._arm = arm
        self._motion = motion
        self._modern = modern

    def handlers(self) -> Handlers:
        """Names of commands, how many parameters they take, and what they do."""
        close, open_ = self._arm.grasp, self._arm.release
        table: Handlers = {
            "UPDATE_TOOL": ((0,), self._update),
            "GET_CURRENT_TOOL_ID": ((0,), lambda: [self._arm.tool.upper()]),
            "GRASP_WITH_TOOL": ((0,), lambda: self._with_tool(close)),
            "RELEASE_WITH_TOOL": ((0,), lambda: self._with_tool(open_)),
            "OPEN_GRIPPER": ((3,), lambda *p: self._gripper("open_gripper", open_, p)),
            "CLOSE_GRIPPER": ((3,), lambda *p: self._gripper("close_gripper", close, p)),
            "PULL_AIR_VACUUM_PUMP": ((0,), lambda: self._act("vacuum_pump", close)),
            "PUSH_AIR_VACUUM_PUMP": ((0,), lambda: self._act("vacuum_pump", open_)),
            "SETUP_ELECTROMAGNET": ((1,), lambda _: self._act("electromagnet", lambda: None)),
            "ACTIVATE_ELECTROMAGNET": ((1,), lambda _: self._act("electromagnet", close)),
            "DEACTIVATE_ELECTROMAGNET": ((1,), lambda _: self._act("electromagnet", open_)),
            "TOOL_REBOOT": ((0,), self._reboot),
            "ENABLE_TCP": ((1,), self._enable_tcp),
            "SET_TCP": ((6,), self._set_tcp),
            "RESET_TCP": ((0,), self._reset_tcp),
            "PICK_FROM_POSE": ((6,), lambda *p: self._pick(pose_from_rpy(numbers(p)))),
            "PLACE_FROM_POSE": ((6,), lambda *p: self._place(pose_from_rpy(numbers(p)))),
            "PICK_AND_PLACE": ((3,), self._pick_and_place),
        }
        if self._modern:
            table["PICK"] = ((1,), lambda position: self._pick(self._motion.pose_of(position)))
            table["PLACE"] = ((1,), lambda position: self._place(self._motion.pose_of(position)))
        return table

    def _update(self) -> Sequence[object]:
        self._arm.detect_tool()
        return ()

    def _with_tool(self, act: Callable[[], None]) -> Sequence[object]:
        """Grasp or release; without a tool nothing happens and the answer is OK."""
        return () if self._arm.tool == "none" else self._work(act)

    def _gripper(
        self, name: str, act: Callable[[], None], params: Sequence[Any]
    ) -> Sequence[object]:
        for value in params:
            of_type(value, int)
        if not self._arm.tool.startswith("gripper"):
            shown = "No Tool" if self._arm.tool == "none" else self._arm.tool
            return self._fail(f"Command '{name}' is not available for {shown}")
        if not 0 <= params[0] < 1000:
            return self._fail("Gripper open speed must be in ( 0, 1000)")
        return self._work(act)

    def _act(self, kind: str, act: Callable[[], None]) -> Sequence[object]:
        if not self._arm.tool.startswith(kind):
            return self._fail(
                f"Tools ID do not match -> Given : {kind} Expected : {self._arm.tool}"
            )
        return self._work(act)

    def _work(self, act: Callable[[], None]) -> Sequence[object]:
        if self._arm.tool_overloaded:
            return self._fail("Gripper action - Timeout")
        act()
        return ()

    def _fail(self, words: str) -> Sequence[object]:
        """A tool that does not do it; system 5 answers OK all the same."""
        if self._modern:
            return ()
        raise RobotRefused(f"Goal has been aborted : {words}")

    def _reboot(self) -> Sequence[object]:
        self._arm.tool_overloaded = False
        return ()

    def _enable_tcp(self, enable: Any) -> Sequence[object]:
        self._arm.tcp_enabled = choice(enable, BOOLEANS)
        return ()

    def _set_tcp(self, *params: Any) -> Sequence[object]:
        self._arm.tcp = pose_from_rpy(numbers(params))
        self._arm.tcp_enabled = True
        return ()

    def _reset_tcp(self) -> Sequence[object]:
        self._arm.reset_tcp()
        return ()

    def _pick(self, pose: Vector) -> Sequence[object]:
        self._with_tool(self._arm.release)
        self._motion.to_pose(_above(pose))
        self._motion.to_pose(pose)
        self._with_tool(self._arm.grasp)
        return self._motion.to_pose(_above(pose))

    def _place(self, pose: Vector) -> Sequence[object]:
        self._motion.to_pose(_above(pose))
        self._motion.to_pose(pose)
        self._with_tool(self._arm.release)
        return self._motion.to_pose(_above(pose))

    def _pick_and_place(self, pick: Any, place: Any, smoothing: Any) -> Sequence[object]:
        of_type(smoothing, float)
        taken, put = self._motion.pose_of(pick), self._motion.pose_of(place)
        self._with_tool(self._arm.release)
        self._motion.through([_above(taken), taken])
        self._with_tool(self._arm.grasp)
        self._motion.through([_above(taken), _above(put), put])
        self._with_tool(self._arm.release)
        return self._motion.to_pose(_above(put))


def _above(pose: Vector) -> Vector:
    raised = pose.copy()
    raised[2, 3] += _ABOVE
    return np.asarray(raised)
