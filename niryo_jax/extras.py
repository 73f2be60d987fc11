"""The packages of the extra `workspace`, which draw and store, imported where they are needed."""

from __future__ import annotations

import importlib
from typing import Any


def need(module: str) -> Any:
    """A module of the extra `workspace`.

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
            f'this needs {package}; install it with: pip install "niryo_jax[workspace]"'
        ) from error
