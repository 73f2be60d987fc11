"""The command `niryo-jax`. Needs the extra `cli`; the rest of the package does without."""

from __future__ import annotations

import gc
import os
import sys

import jax

from niryo_jax import interruption
from niryo_jax._jax import environment_flags
from niryo_jax.cli.outcome import ExitCode, Failure
from niryo_jax.cli.streams import guard_streams


def main() -> None:
    """Run the command with the arguments of this process, and exit with an `ExitCode`."""
    interruption.end_at_once()
    # What is imported stays: looking through it for garbage takes a tenth of a short command.
    gc.freeze()
    arguments = sys.argv[1:] or ["--help"]
    try:
        guard_streams()
        code = _run(arguments)
    except Failure as failure:
        code = failure.report(as_json="--json" in arguments)
    except KeyboardInterrupt:
        code = Failure("interrupted", ExitCode.INTERRUPTED).report(as_json="--json" in arguments)
    interruption.ignore()
    sys.exit(code)


def _run(arguments: list[str]) -> int:
    try:
        from niryo_jax.cli.app import run
        from niryo_jax.cli.cache import keep_programs
    except ModuleNotFoundError as error:
        if error.name not in ("typer", "rich", "platformdirs"):
            raise
        raise Failure(
            f'niryo-jax needs {error.name}; install it with: pip install "niryo_jax[cli]"',
            ExitCode.MISSING_EXTRA,
        ) from error
    jax.config.update("jax_enable_x64", True)
    keep_programs()
    if arguments[0] != "workspace":
        # A handful of poses are solved on the spot; an accelerator takes longer to be found.
        jax.config.update("jax_platforms", os.environ.get("JAX_PLATFORMS") or "cpu")
        os.environ.setdefault("XLA_FLAGS", environment_flags())
    return run(arguments)
