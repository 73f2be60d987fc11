"""An arm in a browser: all its solutions, what it can reach, and a robot while it moves.

Needs the extra `viewer`; importing it needs jax and numpy alone.
"""

from niryo_jax.viewer.app import PORT, Viewer, free_port
from niryo_jax.viewer.session import Session, View
from niryo_jax.viewer.shape import Shape, shape_of

__all__ = ["PORT", "Session", "Shape", "View", "Viewer", "free_port", "shape_of"]
