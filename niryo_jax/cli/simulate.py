"""`niryo-jax simulate`: a simulated robot for other programs."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from niryo_jax.cli.console import stdout
from niryo_jax.cli.options import JsonOption, NiryoOption, RobotName
from niryo_jax.cli.outcome import ExitCode, Failure, print_json
from niryo_jax.cli.serving import until_stopped
from niryo_jax.cli.tables import millimetres
from niryo_jax.hardware import SimulatedNiryo
from niryo_jax.hardware.pick_and_place import OBJECT_START
from niryo_jax.hardware.protocol import PORT


class System(StrEnum):
    """Versions of the robot's system that the simulator can play."""

    V4 = "4.1.1"
    V5 = "5.6.3"


def simulate(
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port to listen on; 0 chooses a free one.")
    ] = PORT,
    time_scale: Annotated[
        float, typer.Option(min=0.01, help="How many times faster than the robot it moves.")
    ] = 1.0,
    object_at: Annotated[
        tuple[float, float],
        typer.Option("--object", metavar="X Y", help="Where the object stands, metres."),
    ] = OBJECT_START[:2],
    system: Annotated[System, typer.Option(help="Version of the robot's system.")] = System.V4,
    robot: NiryoOption = RobotName.NIRYO_ONE,
    as_json: JsonOption = False,
) -> None:
    """Simulate a robot on this machine until Ctrl-C, for pyniryo in any other program."""
    try:
        simulated = SimulatedNiryo(
            robot.model, host=host, port=port, time_scale=time_scale, version=system.value
        )
    except OSError as error:
        raise Failure(f"cannot listen on {host}:{port}: {error}", ExitCode.ROBOT) from error
    out = stdout()
    with simulated:
        wait = until_stopped()
        simulated.place_object((*object_at, 0.0))
        if as_json:
            print_json({"robot": robot.value, "address": simulated.address})
        else:
            out.print(f"A simulated {robot.value} listens on {simulated.address}; Ctrl-C ends it.")
            out.print(f"Try: niryo-jax pick-and-place --host {simulated.address}")
        wait()
        position = simulated.object_position
        if not as_json and position is not None:
            out.print(f"The object is at ({millimetres(position)}) mm.")
