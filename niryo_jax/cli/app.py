"""The commands put together, and every error turned into a sentence and an exit code."""

from __future__ import annotations

import importlib
import os
import sys
import traceback
import warnings
from collections.abc import Sequence
from typing import Annotated

import typer

from niryo_jax._version import __version__
from niryo_jax.cli.outcome import ExitCode, Failure, as_failure

_EXIT_CODES = "\n\n".join(["Exit codes:", *(f"{code:3d}  {code.message}" for code in ExitCode)])

# The module of each command. One command is all that a process needs, so it imports no other.
_MODULES = {
    "fk": "kinematics",
    "ik": "kinematics",
    "pick-and-place": "pick_and_place",
    "simulate": "simulate",
    "describe": "arms",
    "robots": "arms",
    "uncertainty": "uncertainty",
    "workspace": "workspace",
    "calibrate": "calibrate",
    "stack": "stack",
    "view": "view",
}

# Negative numbers look like options to the parser; whatever is no option is left to the arguments.
_NUMBERS = {"ignore_unknown_options": True}


def application(arguments: Sequence[str] = ()) -> typer.Typer:
    """The command with the subcommand that the arguments begin with; else with all."""
    app = typer.Typer(
        name="niryo-jax",
        help="Kinematics of the Niryo arms, and the arms themselves.",
        epilog=f"{_EXIT_CODES}\n\nNIRYO_JAX_DEBUG=1 in the environment shows tracebacks.",
    )
    app.callback()(_root)
    chosen = [name for name in _MODULES if name in arguments[:1]]
    for name in chosen or _MODULES:
        module = importlib.import_module(f"niryo_jax.cli.{_MODULES[name]}")
        command = getattr(module, name.replace("-", "_"))
        if isinstance(command, typer.Typer):
            app.add_typer(command, name=name)
        else:
            settings = _NUMBERS if name in ("fk", "ik", "uncertainty") else None
            app.command(name, context_settings=settings)(command)
    return app


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"niryo_jax {__version__}")
        raise typer.Exit


def _root(
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
            app = application(arguments)
            outcome = app(list(arguments), prog_name="niryo-jax", standalone_mode=False)
            sys.stdout.flush()
            if outcome == ExitCode.INTERRUPTED:  # What typer makes of Ctrl-C.
                raise KeyboardInterrupt
            return outcome if isinstance(outcome, int) else int(ExitCode.DONE)
        except KeyboardInterrupt:
            failure = Failure("interrupted", ExitCode.INTERRUPTED)
        except Exception as error:
            if os.environ.get("NIRYO_JAX_DEBUG"):
                traceback.print_exc()
            failure = _usage_failure(error, arguments) or as_failure(error)
    return failure.report(as_json="--json" in arguments)


def _show_warning(message: Warning | str, *_: object) -> None:
    print(f"warning: {message}", file=sys.stderr)


def _usage_failure(error: Exception, arguments: Sequence[str]) -> Failure | None:
    """Wrong arguments, and Ctrl-C where typer caught it first."""
    if isinstance(error, typer.Abort):
        return Failure("interrupted", ExitCode.INTERRUPTED)
    # typer takes the class of usage errors from click or from its own copy, by its version.
    describe = getattr(error, "format_message", None)
    if describe is None:
        return None
    command = getattr(getattr(error, "ctx", None), "command_path", "niryo-jax")
    said = describe() + _given(error, arguments)
    return Failure(f"{said} (see {command} --help)", ExitCode.USAGE)


def _given(error: Exception, arguments: Sequence[str]) -> str:
    """What was given of an option whose value typer refuses, for it says only what it expected."""
    names = getattr(getattr(error, "param", None), "opts", [])
    if "Input should" not in str(error):
        return ""
    for index, word in enumerate(arguments):
        option, equals, value = word.partition("=")
        if option in names:
            following = arguments[index + 1 : index + 2]
            return f", got {value!r}" if equals else "".join(f", got {x!r}" for x in following)
    return ""
