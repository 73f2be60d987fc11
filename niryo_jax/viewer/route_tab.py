"""The tab of paths: waypoints, the best path through them, and how the arm takes it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from niryo_jax.viewer import route
from niryo_jax.viewer.geometry import places
from niryo_jax.viewer.panel import say
from niryo_jax.viewer.route import Line, Route
from niryo_jax.viewer.session import Session, Vector
from niryo_jax.viewer.task import Task

if TYPE_CHECKING:
    import viser

_THICK = 0.008
"""Of the line of a path, as a share of the reach."""

_RATE = 25.0
"""Samples a second, while the arm takes a path."""


class RouteTab:
    """Waypoints and the path through them.

    Args:
        server: whose scene and panel it is part of.
        tabs: of the panel.
        session: of the arm.
        show_joints: called with joints (n,) to be shown.
        on_error: called with what goes wrong.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        tabs: viser.GuiTabGroupHandle,
        session: Session,
        show_joints: Callable[[Vector], None],
        on_error: Callable[[Exception], None],
    ) -> None:
        self._scene, self._session, self._show_joints = server.scene, session, show_joints
        self._task = Task(on_error)
        self._waypoints: list[NDArray[np.float64]] = []
        self._nodes: list[viser.FrameHandle | viser.LineSegmentsHandle] = []
        self.route: Route | None = None
        gui = server.gui
        with tabs.add_tab("Path"):
            self._said = say(gui.add_html(""))
            add = gui.add_button("Add the target as a waypoint")
            plan = gui.add_button("Best path through the waypoints")
            play = gui.add_button("Play")
            self._along = gui.add_slider("Along it", min=0, max=100, step=1, initial_value=0)
            clear = gui.add_button("Clear", color="gray")
        add.on_click(lambda _: self.add(session.view.target))
        plan.on_click(lambda _: self.plan())
        play.on_click(lambda _: self.play())
        clear.on_click(lambda _: self.clear())

        @self._along.on_update
        def _(event: viser.GuiEvent[viser.GuiSliderHandle[int]]) -> None:
            if event.client is not None:
                self._task.stop()
                self._go(event.target.value / 100)

        self._tell()

    def add(self, pose: NDArray[np.float64]) -> None:
        """Add a waypoint (4, 4) at the end."""
        self._waypoints.append(np.array(pose, np.float64))
        (wxyz,), (position,) = places(self._waypoints[-1][None])
        reach = self._session.shape.reach
        node = self._scene.add_frame(
            f"/path/waypoint_{len(self._waypoints)}",
            axes_length=0.1 * reach,
            axes_radius=0.005 * reach,
            origin_radius=0.015 * reach,
            wxyz=wxyz,
            position=position,
        )
        self._nodes.append(node)
        self._tell()

    def clear(self) -> None:
        """Forget the waypoints and the path."""
        self._task.stop()
        for node in self._nodes:
            node.remove()
        self._nodes, self._waypoints, self.route = [], [], None
        self._tell()

    def plan(self) -> None:
        """Find the best path through the waypoints and draw it."""
        if len(self._waypoints) < 2:
            self._said("Add two waypoints or more first: drag the gizmo, and add its target.")
            return
        waypoints, q_start = np.array(self._waypoints), self._session.view.q
        self._said("Looking for the best path through all solutions ...")

        def run(stop: threading.Event) -> None:
            found = route.plan(self._session.robot, self._session.shape, waypoints, q_start)
            if not stop.is_set():
                self.draw(found)

        self._task.start(run)

    def draw(self, found: Route) -> None:
        """Draw a path, in the place of the one before."""
        self.route = found
        for node in [node for node in self._nodes if "/branch_" in node.name]:
            node.remove()
            self._nodes.remove(node)
        for number, line in enumerate((found.path, *found.branches)):
            self._draw_line(f"/path/branch_{number}", line, 1.0 if number == 0 else 0.6)
        self._tell()

    def _draw_line(self, name: str, line: Line, share: float) -> None:
        if len(line.pieces):
            node = self._scene.add_line_segments(
                name,
                line.pieces,
                colors=line.colour,
                thickness=share * _THICK * self._session.shape.reach,
            )
            self._nodes.append(node)

    def play(self) -> None:
        """Let the arm take the path, as far as it goes."""
        found = self.route
        if found is None or not found.reached:
            self._said("There is no path to take yet.")
            return

        def run(stop: threading.Event) -> None:
            for sample in range(found.reached):
                self._show_joints(found.q[sample])
                self._along.value = round(100 * sample / (len(found.q) - 1))
                if stop.wait(1 / _RATE):
                    return

        self._task.start(run)

    def _go(self, share: float) -> None:
        if self.route is not None and self.route.reached:
            sample = min(round(share * (len(self.route.q) - 1)), self.route.reached - 1)
            self._show_joints(self.route.q[sample])

    def _tell(self) -> None:
        count = len(self._waypoints)
        if self.route is None:
            self._said(f"Waypoints: {count}. The way between two of them is straight.")
            return
        lines = len(self.route.branches)
        self._said(
            f"{self.route.message} Above the path, {lines} branches where they are within the "
            "limits."
        )

    def close(self) -> None:
        """Stop what is under way."""
        self._task.stop()
