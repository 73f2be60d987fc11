"""`niryo-jax view`: an arm in a browser, with all its solutions."""

from __future__ import annotations

import os
import sys
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from niryo_jax.cli.choice import ArmArgument, BaseOption, TipOption, load_arm
from niryo_jax.cli.console import busy, show_lines, stderr
from niryo_jax.cli.options import JsonOption
from niryo_jax.cli.outcome import ExitCode, Failure, print_json
from niryo_jax.cli.serving import until_stopped
from niryo_jax.extras import need
from niryo_jax.robot import Robot
from niryo_jax.robots import catalogue

if TYPE_CHECKING:
    import xarray as xr

_PORT = 8080


def view(
    robot: ArmArgument = None,
    host: Annotated[
        str | None,
        typer.Option(
            metavar="HOST[:PORT]",
            help="A robot whose joints are read and shown; it is never moved.",
        ),
    ] = None,
    map_: Annotated[
        Path | None,
        typer.Option(
            "--map",
            metavar="STORE",
            help="A capability map of `niryo-jax workspace map`, to be drawn as well; its robot is "
            "shown unless another is named.",
        ),
    ] = None,
    address: Annotated[
        str, typer.Option("--bind", metavar="ADDRESS", help="Address of the page.")
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the page; 0 chooses a free one.")
    ] = _PORT,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Whether to open the page.")
    ] = True,
    base: BaseOption = None,
    tip: TipOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show an arm in a browser, all solutions of a pose that is dragged, until Ctrl-C."""
    try:
        need("viser", "viewer")
    except ImportError as error:
        raise Failure(str(error), ExitCode.MISSING_EXTRA) from error
    # Not above: it takes its time to import, and each other command names this one's options.
    from niryo_jax.viewer import Viewer, free_port, shape_of

    try:
        free_port(address, port)  # Before seconds of compiling.
    except OSError as error:
        raise Failure(f"{error}; choose another with --port", ExitCode.USAGE) from error
    found = None if map_ is None else _opened(map_)
    arm = _arm(robot, found, base, tip)
    if host is not None:
        _see(host, arm)
    file = robot if robot is not None and robot not in catalogue.names() else None
    with busy("Solving"):
        shape = shape_of(
            arm, file if file is not None and os.path.isfile(file) else None, base, tip
        )
        viewer = Viewer(arm, shape=shape, map=found, host=host, address=address, port=port)
    with viewer:
        wait = until_stopped()
        if as_json:
            print_json({"robot": arm.name, "url": viewer.url})
        else:
            show_lines(f"{arm.name} is shown at {viewer.url}; Ctrl-C ends it.")
        _open(viewer.url, browser)
        wait()


def _arm(name: str | None, found: xr.Dataset | None, base: str | None, tip: str | None) -> Robot:
    if name is None and found is not None:
        from niryo_jax.workspace import robot_of

        return robot_of(found)
    return load_arm("niryo_one" if name is None else name, base, tip)


def _opened(store: Path) -> xr.Dataset:
    from niryo_jax.workspace import open_map

    try:
        return open_map(store, partial=True)
    except ImportError as error:
        raise Failure(str(error), ExitCode.MISSING_EXTRA) from error


def _see(host: str, arm: Robot) -> None:
    """Look whether the robot answers, which should not be told after seconds of compiling."""
    from niryo_jax.hardware import NiryoArm

    with NiryoArm(host, robot=arm):
        pass


def _open(url: str, wanted: bool) -> None:
    """Open the page where this machine has a screen; else say how to reach it from one."""
    if os.environ.get("SSH_CONNECTION"):
        port = url.rsplit(":", 1)[1]
        stderr().print(
            f"From your own machine: ssh -L {port}:127.0.0.1:{port} THIS-MACHINE, then open {url}"
        )
        return
    shown = sys.platform in ("win32", "darwin") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )
    if wanted and shown:
        webbrowser.open(url)
