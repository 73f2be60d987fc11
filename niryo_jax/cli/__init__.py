"""The command `niryo-jax`. Needs the extra `cli`; the rest of the package does without."""

from __future__ import annotations

import os
import sys

import jax

from niryo_jax.cli.outcome import ExitCode, Failure


def main() -> None:
    """Run the command with the arguments of this process, and exit with an `ExitCode`."""
    try:
        from niryo_jax.cli.app import run
    except ModuleNotFoundError as error:
        if error.name not in ("typer", "rich"):
            raise
        missing = Failure(
            f'niryo-jax needs {error.name}; install it with: pip install "niryo_jax[cli]"',
            ExitCode.MISSING_EXTRA,
        )
        sys.exit(missing.report(as_json="--json" in sys.argv))
    arguments = sys.argv[1:] or ["--help"]
    jax.config.update("jax_enable_x64", True)
    if arguments[0] != "workspace":
        _configure_for_few_poses()
    sys.exit(run(arguments))


def _configure_for_few_poses() -> None:
    """Settings for a process that solves a handful of poses: none of them on import."""
    jax.config.update("jax_platforms", os.environ.get("JAX_PLATFORMS") or "cpu")
    # Compiling takes far longer here than computing, and twice as long when optimised.
    os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")
