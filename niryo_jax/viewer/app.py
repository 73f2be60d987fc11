"""The viewer: a server on this machine whose page shows an arm."""

from __future__ import annotations

import contextlib
import io
import socket
import sys
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from niryo_jax.arguments import check_count, check_text
from niryo_jax.extras import need
from niryo_jax.robot import Robot
from niryo_jax.viewer.map_tab import MapTab
from niryo_jax.viewer.panel import Panel
from niryo_jax.viewer.robot_tab import RobotTab
from niryo_jax.viewer.route_tab import RouteTab
from niryo_jax.viewer.scene import Scene
from niryo_jax.viewer.session import Session, Vector, View
from niryo_jax.viewer.shape import Shape, is_niryo
from niryo_jax.viewer.worker import Worker

if TYPE_CHECKING:
    import viser
    import xarray as xr

PORT = 8080
"""Of the page, where none is given."""

_BRAND = 0, 114, 178


class Viewer:
    """A page that shows an arm; use it in a `with` statement.

    Whoever can reach the address can use it, all of them at once, and sees the same. What is done
    here shows in every browser, and what is done in a browser in all others.

    Args:
        robot: the arm, concrete.
        shape: what it looks like; `shape_of(robot)` where not given.
        covariance: (n, n) of the errors of its joints, rad^2 (m^2 for prismatic joints); 1 mrad
            (1 mm) each where not given.
        map: a capability map, of `workspace.open_map`, to be drawn as well.
        host: of a robot whose joints are read and shown; nothing is ever sent to it but questions.
        address: to listen on; other machines reach 127.0.0.1 through a forwarded port alone.
        port: to listen on; 0 chooses a free one.

    Attributes:
        session: the arm and its solutions; the viewer's own thread uses it.
        server: of viser, for whatever else is to be shown.

    Raises:
        ImportError: viser is not installed; the message names the extra.
        OSError: the port is taken, or the address is none of this machine's.
        ValueError, TypeError: as `Session`; a port that is none.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        shape: Shape | None = None,
        covariance: ArrayLike | None = None,
        map: xr.Dataset | None = None,
        host: str | None = None,
        address: str = "127.0.0.1",
        port: int = PORT,
    ) -> None:
        module = need("viser", "viewer")
        check_text("address", address)
        chosen = free_port(address, check_count("port", port, 0, 65535))
        self.session = Session(robot, shape, covariance)
        self.server: viser.ViserServer = _started(module, address, chosen)
        self._address = address
        self._worker = Worker(self.report)
        self._parts = contextlib.ExitStack()
        try:
            self._furnish(map, host)
        except BaseException:
            self.close()
            raise

    def _furnish(self, map: xr.Dataset | None, host: str | None) -> None:
        server, session = self.server, self.session
        self._configure(session.robot.name)
        self.scene = Scene(server, session.shape, session.slots, self.drag, self.choose)
        self.panel = Panel(server.gui, session, self)
        tabs = self.panel.tabs
        self.route = RouteTab(server, tabs, session, self.show_joints, self.report)
        self._parts.callback(self.route.close)
        if host is not None or is_niryo(session.robot):
            self.robot = RobotTab(server, tabs, session, self, host, self.report)
            self._parts.callback(self.robot.close)
        if map is not None:
            MapTab(server, tabs, map, self._worker.post)
        self._draw(session.view, gizmo=True, sliders=True)

    @property
    def url(self) -> str:
        """Where a browser on this machine finds it."""
        name = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(self._address, self._address)
        return f"http://{name}:{self.server.get_port()}"

    @property
    def view(self) -> View:
        """What is shown."""
        return self.session.view

    def joints(self, q: Vector) -> None:
        """Show the arm at joints (n,), radians (metres for prismatic joints)."""
        self._post("joints", lambda: self.session.set_joints(q), gizmo=True, sliders=False)

    def show_joints(self, q: ArrayLike) -> None:
        """The same, with the sliders."""
        given = np.array(q, np.float64)
        self._post("joints", lambda: self.session.set_joints(given), gizmo=True, sliders=True)

    def show_target(self, pose: ArrayLike) -> None:
        """Show the solutions of a pose (4, 4); the gizmo goes there, and the arm if it can."""
        given = np.array(pose, np.float64)
        self._post("target", lambda: self.session.set_target(given), gizmo=True, sliders=True)

    def drag(self, pose: Vector) -> None:
        """As `show_target` where the gizmo is at the pose already, since it is dragged."""
        self._post("target", lambda: self.session.set_target(pose), gizmo=False, sliders=True)

    def show_live(self, q: ArrayLike | None) -> None:
        """Show the arm of a robot at joints (n,) beside the arm; none where there is nothing."""
        given = None if q is None else np.array(q, np.float64)
        self._worker.post("live", lambda: self._draw_live(given))

    def choose(self, slot: int) -> None:
        """Show the arm in a solution."""
        self._post("choose", lambda: self.session.choose(slot), gizmo=False, sliders=True)

    def follow_tool(self) -> None:
        """Bring the gizmo back to the tool."""
        self._post("tool", lambda: self.session.set_joints(self.view.q), gizmo=True, sliders=True)

    def redraw(self) -> None:
        """Draw again what is shown."""
        self._post("redraw", lambda: self.view, gizmo=False, sliders=False)

    def drawn(self, part: str, visible: bool) -> None:
        """Whether a part of the scene is drawn: ghosts, motion, error, capsules, live."""
        getattr(self.scene, part).visible = visible
        self.redraw()

    def magnify(self, times: float) -> None:
        """How much larger than it is the position error is drawn."""
        self.scene.magnification = times
        self.redraw()

    def settle(self, timeout: float = 60.0) -> bool:
        """Wait until all that was asked for is shown; whether that came in time."""
        return self._worker.settle(timeout)

    def report(self, error: Exception) -> None:
        """Show an error in every browser."""
        for client in self.server.get_clients().values():
            client.add_notification(type(error).__name__, str(error), color="red")

    def close(self) -> None:
        """Stop serving, and all that the viewer has under way."""
        self._parts.close()
        self._worker.close()
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()

    def __enter__(self) -> Viewer:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _post(self, kind: str, update: Callable[[], View], *, gizmo: bool, sliders: bool) -> None:
        self._worker.post(kind, lambda: self._draw(update(), gizmo=gizmo, sliders=sliders))

    def _draw(self, view: View, *, gizmo: bool, sliders: bool) -> None:
        self.panel.show(view, move_sliders=sliders)
        self.scene.show(view, move_gizmo=gizmo)

    def _draw_live(self, q: Vector | None) -> None:
        if q is not None:
            self.scene.live.move(self.session.joints_of(q).links[0])
        self.scene.live.visible = q is not None

    def _configure(self, name: str) -> None:
        gui = self.server.gui
        gui.set_panel_label(f"niryo_jax: {name}")
        # A shared page would be on the internet.
        gui.configure_theme(
            control_width="large", show_logo=False, show_share_button=False, brand_color=_BRAND
        )


def free_port(address: str, port: int) -> int:
    """The port, or a free one for 0, once it is seen that it can be listened on.

    Raises:
        OSError: it is taken, or the address is none of this machine's; the message says which.
    """
    try:
        family = socket.getaddrinfo(address, port, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            # As the server itself: a port whose last connections have just ended is free. Windows
            # needs no word for that, and takes it for leave to listen on a port that is taken.
            if sys.platform != "win32":
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((address, port))
            return int(probe.getsockname()[1])
    except OSError as error:
        raise OSError(f"cannot listen on {address}:{port}: {error.strerror or error}") from error


def _started(module: Any, address: str, port: int) -> viser.ViserServer:
    """A server, which else would take the next port where this one is taken."""
    with contextlib.redirect_stdout(io.StringIO()):
        server: viser.ViserServer = module.ViserServer(address, port, verbose=False)
        if server.get_port() != port:
            server.stop()
            raise OSError(f"cannot listen on {address}:{port}: another program was sooner")
    return server
