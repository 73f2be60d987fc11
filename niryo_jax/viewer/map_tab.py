"""The tab of a capability map: what of it is drawn, and where it is cut."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from niryo_jax.viewer.panel import say
from niryo_jax.viewer.voxels import Voxels, variables_of
from niryo_jax.workspace.variables import VOXELS

if TYPE_CHECKING:
    import viser
    import xarray as xr

_MIDDLE = 0.5
"""Where the map is cut at first: across y, so that the arm is seen."""


class MapTab:
    """A capability map as voxels, cut by a plane.

    Args:
        server: whose scene and panel it is part of.
        tabs: of the panel.
        map: that is shown.
        post: called with a kind of action and an action that is to be done.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        tabs: viser.GuiTabGroupHandle,
        map: xr.Dataset,
        post: Callable[[str, Callable[[], None]], None],
    ) -> None:
        self._map, self._post = map, post
        names = variables_of(map)
        if not names:
            raise ValueError("map: expected a variable over the voxels, got none")
        self.voxels = Voxels.of_map(map, names[0])
        self._cloud = server.scene.add_point_cloud(
            "/map",
            np.zeros((0, 3), np.float32),
            np.zeros((0, 3), np.uint8),
            point_size=0.55 * self.voxels.edge,
            point_shape="circle",
            point_shading="gradient",
            precision="float32",
        )
        gui = server.gui
        with tabs.add_tab("Map"):
            visible = gui.add_checkbox("Shown", True)
            self._of = gui.add_dropdown("Value", names, initial_value=names[0])
            self._axis = gui.add_dropdown("Cut across", VOXELS, initial_value="y")
            self._share = gui.add_slider(
                "Cut at", min=0.0, max=1.0, step=0.01, initial_value=_MIDDLE
            )
            self._said = say(gui.add_html(""))
        visible.on_update(lambda event: setattr(self._cloud, "visible", event.target.value))
        self._of.on_update(lambda _: post("map", self._change))
        self._axis.on_update(lambda _: post("cut", self._draw))
        self._share.on_update(lambda _: post("cut", self._draw))
        self._draw()

    def _change(self) -> None:
        self.voxels = Voxels.of_map(self._map, self._of.value)
        self._draw()

    def _draw(self) -> None:
        voxels, axis = self.voxels, VOXELS.index(self._axis.value)
        kept = voxels.cut(axis, self._share.value)
        self._cloud.points, self._cloud.colors = voxels.surface(kept)
        units = self._map[voxels.of].attrs.get("units", "1")
        unit = "" if units == "1" else f" {units}"
        self._said(
            f"{int(np.sum(kept)):,} of {int(np.sum(voxels.there)):,} voxels of "
            f"{1e3 * voxels.edge:g} mm; dark blue is {voxels.least:.3g}{unit}, "
            f"yellow {voxels.most:.3g}{unit}."
        )
