"""The scene: the arm, its ghosts, the gizmo at the tool, ellipsoids, and the table."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from niryo_jax.uncertainty.normal import radius_of
from niryo_jax.viewer import colours
from niryo_jax.viewer.arms import Ghosts, SolidArm
from niryo_jax.viewer.geometry import ellipsoid, places, pose_of, unit_sphere
from niryo_jax.viewer.session import View
from niryo_jax.viewer.shape import Shape

if TYPE_CHECKING:
    import viser

PROBABILITY = 0.95
"""That a position error lies inside its ellipsoid."""

_NEAR = 0.01
"""Metres of clearance below which capsules are painted as a warning."""

_INSET = 0.008
"""How much thinner ghosts are than the arm, as a share of the reach."""

_MOTION_SIZE = 0.35
"""The largest half axis of the ellipsoid of manipulability, as a share of the reach, for a tool
that moves by the reach where the joint rates have length 1."""


class Scene:
    """What is drawn, which follows a `View`.

    Args:
        server: whose scene it is.
        shape: of the arm.
        slots: how many solutions there can be.
        on_drag: called with a pose (4, 4) while the gizmo is dragged.
        on_choose: called with the slot of a ghost that was clicked.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        shape: Shape,
        slots: int,
        on_drag: Callable[[NDArray[np.float64]], None],
        on_choose: Callable[[int], None],
    ) -> None:
        self._server = server
        self._reach = reach = shape.reach
        scene = server.scene
        _furnish(server, reach)
        self.arm = SolidArm(scene, "/arm", shape.meshes, colours.LINKS)
        self.ghosts = Ghosts(scene, "/solutions", shape.meshes, _INSET * reach, slots, on_choose)
        self.live = SolidArm(scene, "/live", shape.meshes, (colours.LIVE,), 0.6, visible=False)
        self.capsules = SolidArm(
            scene, "/capsules", shape.capsules(), (colours.FREE,), 0.35, visible=False
        )
        ball = unit_sphere()
        self.motion, self.error = (
            scene.add_mesh_simple(
                name,
                ball.vertices,
                ball.faces,
                color=colour,
                opacity=0.4,
                cast_shadow=False,
                receive_shadow=False,
                visible=False,
            )
            for name, colour in (
                ("/manipulability", colours.MOTION),
                ("/position_error", colours.ERROR),
            )
        )
        self.magnification = 20.0
        self._quantile = radius_of(PROBABILITY)
        self._gizmo = scene.add_transform_controls(
            "/target", scale=0.3 * reach, line_width=3.0, depth_test=False, opacity=0.9
        )

        # Awaited one after the other, where functions of threads may overtake each other.
        @self._gizmo.on_update
        async def _(event: viser.TransformControlsEvent) -> None:
            on_drag(pose_of(event.target.wxyz, event.target.position))

    def show(self, view: View, *, move_gizmo: bool) -> None:
        """Draw a view.

        Args:
            view: what is shown.
            move_gizmo: whether the gizmo goes to the target; not while it is dragged.
        """
        measures = view.measures
        shown = view.found.copy()
        if view.chosen is not None:
            shown[view.chosen] = False
        with self._server.atomic():
            self.arm.move(measures.links[0])
            self.ghosts.move(measures.links[1:], shown, colours_of(view))
            if self.capsules.visible:
                self._paint_capsules(view)
            self._stretch(view)
            if move_gizmo:
                (wxyz,), (position,) = places(view.target[None])
                self._gizmo.wxyz, self._gizmo.position = wxyz, position
        self._server.flush()

    def _paint_capsules(self, view: View) -> None:
        self.capsules.move(view.measures.links[0])
        apart = view.clearance()
        if apart is not None:
            near = colours.NEAR if apart < _NEAR else colours.FREE
            self.capsules.paint(colours.TOUCHING if apart < 0 else near)

    def _stretch(self, view: View) -> None:
        measures = view.measures
        sizes = (_MOTION_SIZE, self.magnification * self._quantile)
        matrices = measures.motion, measures.error
        for node, matrix, size in zip((self.motion, self.error), matrices, sizes):
            if node.visible:
                wxyz, half = ellipsoid(matrix)
                # An ellipsoid that is flat has no normals there.
                x, y, z = np.maximum(size * half, 1e-3 * self._reach).tolist()
                node.wxyz, node.position = wxyz, measures.tool[0, :3, 3]
                node.scale = (x, y, z)


def colours_of(view: View) -> NDArray[np.uint8]:
    """(slots, 3) by branch, and grey outside the joint limits."""
    painted = [
        colours.of_branch(int(branch)) if within else colours.OUTSIDE
        for branch, within in zip(view.branches, view.within)
    ]
    return np.array(painted, np.uint8)


def _furnish(server: viser.ViserServer, reach: float) -> None:
    """The table, the base frame, the light, and where the camera stands at first."""
    scene = server.scene
    scene.configure_default_lights(enabled=True, cast_shadow=True)
    cell = float(10.0 ** np.floor(np.log10(reach)))
    scene.add_grid(
        "/table",
        infinite_grid=True,
        cell_size=cell,
        section_size=5 * cell,
        cell_color=(228, 231, 235),
        section_color=(206, 211, 217),
        fade_distance=9 * reach,
        fade_strength=1.5,
        fade_from="origin",
        shadow_opacity=0.15,
    )
    scene.add_frame(
        "/base", axes_length=0.25 * reach, axes_radius=0.004 * reach, origin_radius=0.008 * reach
    )
    camera = server.initial_camera
    camera.fov = 0.7
    camera.position = (2.6 * reach, -2.2 * reach, 1.8 * reach)
    # The panel covers the right of the picture.
    camera.look_at = (0.3 * reach, 0.35 * reach, 0.45 * reach)
