"""The tab of robots: the pick-and-place of a simulated one, and the joints of a real one."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

import numpy as np

from niryo_jax.hardware import MotionStopped, NiryoArm, NiryoError, SimulatedNiryo
from niryo_jax.hardware.pick_and_place import (
    OBJECT_START,
    Plan,
    StepRecord,
    execute,
    plan,
    steps_for,
)
from niryo_jax.robots import MODELS
from niryo_jax.viewer.colours import THING
from niryo_jax.viewer.panel import say
from niryo_jax.viewer.session import Session, Vector
from niryo_jax.viewer.shape import is_niryo
from niryo_jax.viewer.task import Task

if TYPE_CHECKING:
    import viser

_FRAMES = 25.0
"""Pictures a second of a simulated robot."""

_READS = 5.0
"""Readings a second of a real one, and seconds until it is tried again where it is lost."""
_AGAIN = 2.0

_PATIENCE = 2.0
"""Seconds for which an answer of a robot is still waited for at the end."""

_PIECE = 0.4
"""Seconds after which a move of the simulated robot can be stopped."""

_CUBE = 0.03
"""The edge of the thing that is picked, metres, as it is drawn."""


class Show(Protocol):
    """What a robot's joints are shown by; each returns at once."""

    def show_joints(self, q: Vector) -> None:
        """The arm, at joints (n,)."""
        ...

    def show_live(self, q: Vector | None) -> None:
        """The arm of the robot, at joints (n,); none where there is nothing to show."""
        ...


class RobotTab:
    """A simulated robot that picks and places, and a real one that is read.

    Nothing is sent to a real robot but questions.

    Args:
        server: whose scene and panel it is part of.
        tabs: of the panel.
        session: of the arm.
        show: what shows joints.
        host: of a robot to read; none where not given.
        on_error: called with what goes wrong.

    Attributes:
        thing: what the simulated robot picks, as it is drawn.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        tabs: viser.GuiTabGroupHandle,
        session: Session,
        show: Show,
        host: str | None,
        on_error: Callable[[Exception], None],
    ) -> None:
        self._session, self._show, self._host = session, show, host
        self._playing, self._reading = Task(on_error), Task(on_error)
        gui = server.gui
        self.thing = server.scene.add_box(
            "/thing", color=THING, dimensions=(_CUBE, _CUBE, _CUBE), visible=False
        )
        self._follow: viser.GuiInputHandle[bool] | None = None
        with tabs.add_tab("Robot"):
            if is_niryo(session.robot):
                self._step = say(gui.add_html(""))
                play = gui.add_button("Play the pick-and-place (simulated)")
                stop = gui.add_button("Stop", color="gray")
                self._faster = gui.add_slider(
                    "Faster by", min=0.5, max=10.0, step=0.5, initial_value=1.0
                )
                play.on_click(lambda _: self.play())
                stop.on_click(lambda _: self._playing.stop())
                self._step("Ten steps of a simulated robot, over the robot's own protocol.")
            if host is not None:
                self._live = say(gui.add_html(""))
                self._follow = gui.add_checkbox(
                    "Follow it", False, hint="Show the solutions of where the robot is."
                )
        if host is not None:
            self._reading.start(lambda stop: self._read(host, stop))

    @property
    def speed(self) -> float:
        """How many times faster than the robot the simulated one moves."""
        return float(self._faster.value)

    @speed.setter
    def speed(self, times: float) -> None:
        self._faster.value = times

    def play(self) -> None:
        """Let a simulated robot carry out the pick-and-place from its first step."""
        model = MODELS[self._session.robot.name]
        speed = self.speed

        def run(stop: threading.Event) -> None:
            self._step("Solving the poses ...")
            planned = plan(self._session.robot, steps_for(self._session.robot))
            with SimulatedNiryo(model, time_scale=speed) as simulated:
                simulated.place_object(OBJECT_START)
                watcher = threading.Thread(target=self._watch, args=(simulated, stop), daemon=True)
                watcher.start()
                try:
                    self._drive(simulated, planned, stop)
                finally:
                    stop.set()
                    watcher.join()
                    self.thing.visible = False

        self._playing.start(run)

    def _drive(self, simulated: SimulatedNiryo, planned: Plan, stop: threading.Event) -> None:
        steps, done = len(planned.steps), list[StepRecord]()

        def tell(record: StepRecord) -> None:
            done.append(record)
            self._step(f"{len(done)} of {steps}: {record.planned.step.title}")
            if stop.is_set():
                raise MotionStopped("stopped", record.reached, record.reached)

        robot = self._session.robot
        with NiryoArm(simulated.address, robot=robot, piece=_PIECE / self.speed) as arm:
            ending = threading.Thread(target=lambda: (stop.wait(), arm.stop()), daemon=True)
            ending.start()
            try:
                arm.calibrate()
                arm.use_tool("gripper_1")
                arm.release()
                execute(planned, arm, tell)
            except MotionStopped:
                self._step("Stopped.")
            else:
                self._step(f"Done: all {steps} steps.")

    def _watch(self, simulated: SimulatedNiryo, stop: threading.Event) -> None:
        """Show a simulated robot and its thing until it is told to stop."""
        while not stop.wait(1 / _FRAMES):
            self._show.show_joints(simulated.arm.joints)
            place = simulated.object_position
            if place is not None:
                self.thing.position = place + np.array([0.0, 0.0, _CUBE / 2])
                self.thing.visible = True

    def _read(self, host: str, stop: threading.Event) -> None:
        """Show the joints of a robot, over and over, also after it was lost."""
        while not stop.is_set():
            try:
                with NiryoArm(host, robot=self._session.robot) as arm:
                    self._live(f"Reading the robot at {host}, {_READS:g} times a second.")
                    while not stop.wait(1 / _READS):
                        q = arm.joints()
                        self._show.show_live(q)
                        if self._follow is not None and self._follow.value:
                            self._show.show_joints(q)
            except NiryoError as error:
                self._show.show_live(None)
                self._live(f"{error}. It is tried again every {_AGAIN:g} seconds.")
                stop.wait(_AGAIN)

    def close(self) -> None:
        """Stop what is under way."""
        self._playing.stop(_PATIENCE)
        self._reading.stop(_PATIENCE)
