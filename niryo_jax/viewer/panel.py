"""The panel beside the scene: sliders, what is said of the solutions, and what is drawn."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

import numpy as np

from niryo_jax.viewer import words
from niryo_jax.viewer.scene import PROBABILITY
from niryo_jax.viewer.session import Session, Vector, View

if TYPE_CHECKING:
    import viser

_GROUP = 8
"""Buttons in a row."""

_STEP, _ROUNDING = 0.1, 1e-6
"""Of sliders, in degrees or millimetres, and a share of it that is none."""


class Actions(Protocol):
    """What the panel asks for; each returns at once."""

    def joints(self, q: Vector) -> None:
        """Show the arm at joints (n,)."""
        ...

    def show_joints(self, q: Vector) -> None:
        """The same, with the sliders."""
        ...

    def choose(self, slot: int) -> None:
        """Show the arm in a solution."""
        ...

    def follow_tool(self) -> None:
        """Bring the gizmo back to the tool."""
        ...

    def redraw(self) -> None:
        """Draw again what is shown."""
        ...

    def drawn(self, part: str, visible: bool) -> None:
        """Whether a part of the scene is drawn."""
        ...

    def magnify(self, times: float) -> None:
        """How much larger than it is the position error is drawn."""
        ...


class Panel:
    """Sliders, words and toggles.

    Args:
        gui: that it is part of.
        session: of the arm.
        actions: what is asked for.

    Attributes:
        tabs: in which others put what they have to show.
    """

    def __init__(self, gui: viser.GuiApi, session: Session, actions: Actions) -> None:
        self._session, self._actions = session, actions
        self._lock = threading.Lock()
        self._said = np.full(session.robot.joints, np.nan)
        self._q = session.view.q
        self._units = np.where(session.slides, 1e-3, np.deg2rad(1.0))
        self._ends = ends_of(session.lower, session.upper, self._units)
        self._status = gui.add_html("")
        self._solutions = gui.add_html("")
        self._take = [self._buttons(gui, first) for first in range(0, session.slots, _GROUP)]
        self.tabs = gui.add_tab_group()
        with self.tabs.add_tab("Joints"):
            self._sliders = [self._slider(gui, joint) for joint in range(session.robot.joints)]
            back = gui.add_button("Gizmo back to the tool")
            back.on_click(lambda _: actions.follow_tool())
            start = gui.add_button("Arm back to the start")
            start.on_click(lambda _: actions.show_joints(session.start))
        with self.tabs.add_tab("Show"):
            self._toggles(gui, session)

    def _buttons(self, gui: viser.GuiApi, first: int) -> viser.GuiButtonGroupHandle:
        last = min(first + _GROUP, self._session.slots)
        group = gui.add_button_group(
            "Take" if first == 0 else "or", [str(slot + 1) for slot in range(first, last)]
        )
        group.on_click(lambda event: self._actions.choose(int(event.target.value) - 1))
        return group

    def _slider(self, gui: viser.GuiApi, joint: int) -> viser.GuiSliderHandle[float]:
        session = self._session
        least, most = (float(end[joint]) for end in self._ends)
        slider = gui.add_slider(
            f"{session.robot.joint_names[joint]} ({'mm' if session.slides[joint] else '°'})",
            min=least,
            max=most,
            step=_STEP,
            initial_value=least,
        )

        @slider.on_update
        def _(event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
            if event.client is not None:  # Not where the program has moved it.
                self._actions.joints(self._joints())

        return slider

    def _joints(self) -> Vector:
        """What the sliders stand for: of those that were moved what they say, of all others the
        joints that they were put to, which they say rounded."""
        with self._lock:
            said = np.array([slider.value for slider in self._sliders])
            self._q = np.where(said == self._said, self._q, said * self._units)
            self._said = said
            return self._q

    def _toggles(self, gui: viser.GuiApi, session: Session) -> None:
        self._toggle(gui, "Ghosts", "ghosts", True, "All other solutions of the target.")
        self._toggle(gui, "Mobility", "motion", False, "The ellipsoid of manipulability.")
        hint = f"Where the tool is with a probability of {PROBABILITY:.0%}, magnified."
        self._toggle(gui, "Error", "error", False, hint)
        times = gui.add_slider("Error times", min=1, max=200, step=1, initial_value=20, hint=hint)
        times.on_update(lambda event: self._actions.magnify(float(event.target.value)))
        if session.shape.model is not None:
            hint = "What clearances are of: green apart, amber within 10 mm, red touching."
            self._toggle(gui, "Capsules", "capsules", False, hint)

    def _toggle(self, gui: viser.GuiApi, label: str, part: str, initial: bool, hint: str) -> None:
        box = gui.add_checkbox(label, initial_value=initial, hint=hint)
        box.on_update(lambda event: self._actions.drawn(part, event.target.value))

    def show(self, view: View, *, move_sliders: bool) -> None:
        """Say what there is to say of a view.

        Args:
            view: what is shown.
            move_sliders: whether the sliders go to its joints; not while they are dragged.
        """
        self._status.content = words.status(view)
        self._solutions.content = words.solutions(view)
        for first, group in zip(range(0, self._session.slots, _GROUP), self._take):
            count = min(int(np.sum(view.found)) - first, _GROUP)
            group.visible = count > 0
            if count > 0:
                group.options = tuple(str(first + slot + 1) for slot in range(count))
        if move_sliders:
            self._put(view.q)

    def _put(self, q: Vector) -> None:
        with self._lock:
            self._q = q
            for joint, slider in enumerate(self._sliders):
                shown = float(np.clip(q[joint] / self._units[joint], slider.min, slider.max))
                self._said[joint] = slider.value = round(shown, 1)


def ends_of(lower: Vector, upper: Vector, units: Vector) -> tuple[Vector, Vector]:
    """(n,) the ends of sliders in so many units: the limits, drawn in to what a slider shows."""
    least = np.round(np.ceil(lower / units / _STEP - _ROUNDING) * _STEP, 1)
    most = np.round(np.floor(upper / units / _STEP + _ROUNDING) * _STEP, 1)
    return least, np.maximum(least, most)


def say(handle: viser.GuiHtmlHandle) -> Callable[[str], None]:
    """What writes a line of plain text into a place of the panel."""

    def write(text: str) -> None:
        handle.content = words.panel(words.line(text))

    return write
