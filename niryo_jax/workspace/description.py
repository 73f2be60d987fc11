"""A robot as text, so that a map says which arm it is of and can be taken up again."""

from __future__ import annotations

import functools
import json
from typing import TYPE_CHECKING, Any

import numpy as np

from niryo_jax.collision import CollisionCheck
from niryo_jax.robot import Robot
from niryo_jax.workspace.fields import check_map

if TYPE_CHECKING:
    import xarray as xr


def robot_text(robot: Robot) -> str:
    """The JSON document of a robot; a limit that there is not is null."""

    def limits(values: Any) -> list[float | None]:
        return [float(x) if np.isfinite(x) else None for x in np.asarray(values, np.float64)]

    document = {
        "name": robot.name,
        "joint_names": list(robot.joint_names),
        "screws": np.asarray(robot.screws, np.float64).tolist(),
        "home": np.asarray(robot.home, np.float64).tolist(),
        "lower": limits(robot.lower),
        "upper": limits(robot.upper),
    }
    return json.dumps(document, allow_nan=False)


@functools.lru_cache(maxsize=16)
def robot_from(text: str) -> Robot:
    """The robot of a JSON document: one for one text, so that its programs are compiled once.

    Raises:
        ValueError: the text is not such a document.
    """
    try:
        document = json.loads(text)
        lower, upper = (
            [none if x is None else x for x in document[name]]
            for name, none in (("lower", -np.inf), ("upper", np.inf))
        )
        return Robot.from_screws(
            document["screws"],
            document["home"],
            lower=lower,
            upper=upper,
            joint_names=document["joint_names"],
            name=document["name"],
        )
    except (KeyError, TypeError, json.JSONDecodeError) as error:
        raise ValueError(
            f"expected the JSON document of a robot, got {str(text)[:80]!r}"
        ) from error


def robot_of(map: xr.Dataset) -> Robot:
    """The robot that a map was made of.

    Raises:
        ValueError: the dataset does not say.
    """
    check_map("map", map)
    if "robot" not in map.attrs:
        raise ValueError("map: expected a workspace map, whose attributes name its robot")
    return robot_from(str(map.attrs["robot"]))


def collisions_of(map: xr.Dataset) -> CollisionCheck | None:
    """What the arm had to stay clear of in a map; None where collisions were not looked at.

    Raises:
        ValueError: the map's attributes are damaged.
    """
    check_map("map", map)
    text = map.attrs.get("collisions")
    return None if text is None else CollisionCheck.from_text(str(text))
