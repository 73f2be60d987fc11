"""The robots that the package brings, by name."""

from __future__ import annotations

import functools
from collections.abc import Callable

from niryo_jax.arguments import check_choice
from niryo_jax.robot import Robot
from niryo_jax.robots import book, niryo

_BUILDERS: dict[str, Callable[[], Robot]] = {
    "niryo_one": niryo.niryo_one,
    "niryo_ned": niryo.niryo_ned,
    "niryo_ned2": niryo.niryo_ned2,
    "niryo_one_report": book.niryo_one_report,
    "abb_irb120": book.abb_irb120,
    "abb_irb120_up": functools.partial(book.abb_irb120, "up"),
    "abb_irb1600": book.abb_irb1600,
    "abb_irb6620lx": book.abb_irb6620lx,
    "abb_irb910sc": book.abb_irb910sc,
    "kuka_iiwa14": book.kuka_iiwa14,
    "ur16e": book.ur16e,
    "rttr": book.rttr,
}


def names() -> tuple[str, ...]:
    """The names that `load` knows."""
    return tuple(_BUILDERS)


def load(name: str) -> Robot:
    """A robot that the package brings, as its function builds it without arguments.

    Args:
        name: one of `names()`.

    Raises:
        ValueError: an unknown name; the message lists the known ones.
    """
    check_choice("name", name, _BUILDERS)
    return _BUILDERS[name]()
