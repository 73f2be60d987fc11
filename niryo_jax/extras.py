"""Packages of the extras, imported where they are needed."""

from __future__ import annotations

import importlib
from typing import Any


def need(module: str, extra: str = "workspace") -> Any:
    """A module of an extra.

    Raises:
        ImportError: it is not installed; the message names the extra.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        package = module.split(".")[0]
        if error.name is None or error.name.split(".")[0] != package:
            raise
        raise ImportError(
            f'this needs {package}; install it with: pip install "niryo_jax[{extra}]"'
        ) from error
