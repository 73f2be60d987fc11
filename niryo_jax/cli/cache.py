"""Compiled programs kept between calls of the command, which would spend its time compiling them.

Only the command does this: a library sets nothing on import.
"""

from __future__ import annotations

import os
from pathlib import Path

import jax
import platformdirs

VARIABLE = "NIRYO_JAX_CACHE_DIR"
"""Where programs are kept; the platform's cache folder where it is not set, nowhere if empty."""


def keep_programs() -> None:
    """Keep compiled programs, unless the caller's JAX does already or nothing can be written."""
    chosen = os.environ.get(VARIABLE)
    if chosen == "" or os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        return
    folder = Path(chosen) if chosen else platformdirs.user_cache_path("niryo_jax") / "programs"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return
    if os.access(folder, os.W_OK):
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.02)
        jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
