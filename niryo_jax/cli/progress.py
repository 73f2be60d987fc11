"""The steps of a task while a robot executes them, on stderr."""

from __future__ import annotations

from types import TracebackType
from typing import Generic, TypeVar

from rich.console import Group
from rich.live import Live
from rich.spinner import Spinner
from rich.text import Text

from niryo_jax.cli.console import stderr
from niryo_jax.cli.tables import millimetres
from niryo_jax.hardware import SimulatedNiryo
from niryo_jax.hardware.pick_and_place import Plan

Record = TypeVar("Record")


class StepProgress(Generic[Record]):
    """A line for each step done, and on a terminal a moving one for the step under way.

    Args:
        plan: the steps.
        simulated: the robot, where it is simulated: its tool and object are shown as they move.

    Attributes:
        records: the steps done so far.
    """

    def __init__(self, plan: Plan, simulated: SimulatedNiryo | None) -> None:
        self.records: list[Record] = []
        self._titles = [planned.step.title for planned in plan.steps]
        self._simulated = simulated
        self._console = stderr()
        self._spinner = Spinner("dots")
        self._live = Live(
            get_renderable=self._render,
            console=self._console,
            transient=True,
            refresh_per_second=12,
        )

    def advance(self, record: Record) -> None:
        """Note that a step is done."""
        self.records.append(record)
        if not self._console.is_terminal:
            self._console.print(self._line(len(self.records)))

    def __enter__(self) -> StepProgress[Record]:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._live.stop()

    def _line(self, number: int) -> str:
        return f"{number:3d}/{len(self._titles)}  {self._titles[number - 1]}"

    def _render(self) -> Group:
        done = len(self.records)
        lines = [Text(self._line(number)) for number in range(1, done + 1)]
        if done == len(self._titles):
            return Group(*lines)
        self._spinner.update(text=f"{self._line(done + 1)}{self._state()}")
        return Group(*lines, self._spinner)

    def _state(self) -> str:
        if self._simulated is None:
            return ""
        tool = millimetres(self._simulated.arm.pose[:3, 3], decimals=0)
        state = f"   tool at ({tool}) mm"
        position = self._simulated.object_position
        if position is not None:
            state += f", object at ({millimetres(position, decimals=0)}) mm"
        return state
