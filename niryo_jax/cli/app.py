"""The commands put together, and every error turned into a sentence and an exit code."""

from __future__ import annotations

import os
import sys
import traceback
import warnings
from collections.abc import Sequence
from importlib.metadata import version
from typing import Annotated

import typer

from niryo_jax.cli.arms import describe, robots
from niryo_jax.cli.kinematics import fk, ik
from niryo_jax.cli.outcome import ExitCode, Failure, as_failure
from niryo_jax.cli.pick_and_place import pick_and_place
from niryo_jax.cli.simulate import simulate
from niryo_jax.cli.workspace import workspace

_EXIT_CODES = "\n\n".join(["Exit codes:", *(f"{code:3d}  {code.message}" for code in ExitCode)])

app = typer.Typer(
    name="niryo-jax",
    help="Kinematics of the Niryo arms, and the arms themselves.",
    epilog=f"{_EXIT_CODES}\n\nNIRYO_JAX_DEBUG=1 in the environment shows tracebacks.",
    add_completion=False,
)
# Negative numbers look like options to the parser; whatever is no option is left to the arguments.
_NUMBERS = {"ignore_unknown_options": True}
app.command("fk", context_settings=_NUMBERS)(fk)
app.command("ik", context_settings=_NUMBERS)(ik)
app.command("pick-and-place")(pick_and_place)
app.command("simulate")(simulate)
app.command("describe")(describe)
app.command("robots")(robots)
app.add_typer(workspace, name="workspace")


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"niryo_jax {version('niryo_jax')}")
        raise typer.Exit


@app.callback()
def root(
    _version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version."),
    ] = False,
) -> None:
    """Kinematics of the Niryo arms, and the arms themselves."""


def run(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code."""
    with warnings.catch_warnings():
        warnings.showwarning = _show_warning
        try:
            outcome = app(list(arguments), prog_name="niryo-jax", standalone_mode=False)
            if outcome != ExitCode.INTERRUPTED:
                return outcome if isinstance(outcome, int) else int(ExitCode.DONE)
            # typer makes a silent exit code of Ctrl-C.
            failure = Failure("interrupted", ExitCode.INTERRUPTED)
        except KeyboardInterrupt:
            failure = Failure("interrupted", ExitCode.INTERRUPTED)
        except Exception as error:
            if os.environ.get("NIRYO_JAX_DEBUG"):
                traceback.print_exc()
            failure = _usage_failure(error) or as_failure(error)
    return failure.report(as_json="--json" in arguments)


def _show_warning(message: Warning | str, *_: object) -> None:
    print(f"warning: {message}", file=sys.stderr)


def _usage_failure(error: Exception) -> Failure | None:
    """Wrong arguments, and Ctrl-C where typer caught it first."""
    if isinstance(error, typer.Abort):
        return Failure("interrupted", ExitCode.INTERRUPTED)
    # typer takes the class of usage errors from click or from its own copy, by its version.
    describe = getattr(error, "format_message", None)
    if describe is None:
        return None
    command = getattr(getattr(error, "ctx", None), "command_path", "niryo-jax")
    return Failure(f"{describe()} (see {command} --help)", ExitCode.USAGE)
