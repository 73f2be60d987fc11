"""How a command ends: exit codes, and errors as one sentence or one JSON document."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping

from niryo_jax import interruption
from niryo_jax.codes import Code


class ExitCode(Code):
    """What scripts can rely on."""

    DONE = 0, "done"
    UNEXPECTED = 1, "unexpected error: please report it"
    USAGE = 2, "wrong arguments, or a pose that is no rigid motion"
    NO_SOLUTION = 3, "no joint angles within the limits reach the pose"
    ROBOT = 4, "the robot cannot be reached, refused, or did not get there"
    MISSING_EXTRA = 5, "an optional package is not installed"
    STORE = 6, "a map's store cannot be used or written"
    OUTPUT = 7, "standard output is closed or full"
    COLLISION = 8, "all joint angles within the limits, or a move of a plan, collide"
    INTERRUPTED = interruption.INTERRUPTED, "interrupted with Ctrl-C"
    PIPE = 141, "the program that read the output ended before its end"


class Failure(Exception):
    """A command that ends with another code than DONE.

    Args:
        message: one sentence for a person.
        code: the exit code.
        details: what else the JSON document holds, e.g. the results so far.
    """

    def __init__(
        self, message: str, code: ExitCode, details: Mapping[str, object] | None = None
    ) -> None:
        super().__init__(message)
        self.code = code
        self.details = details or {}

    def report(self, *, as_json: bool) -> int:
        """Write the error to stderr, or as JSON to stdout, and return the exit code."""
        if as_json:
            print_json({"error": str(self), "exit_code": int(self.code), **self.details})
        else:
            print(f"error: {self}", file=sys.stderr)
        return int(self.code)


def as_failure(error: Exception) -> Failure:
    """Any error, as a sentence and an exit code."""
    # Not above: most commands need neither a robot nor a map, and importing them takes its time.
    from niryo_jax.hardware import ArgumentRejected, NiryoError, PyniryoMissing
    from niryo_jax.hardware.pick_and_place import StepUnsolvable
    from niryo_jax.hardware.plan_clearance import StepCollides
    from niryo_jax.workspace import StoreError

    match error:
        case Failure():
            return error
        case StepUnsolvable():
            code = ExitCode.NO_SOLUTION
        case StepCollides():
            code = ExitCode.COLLISION
        case PyniryoMissing():
            code = ExitCode.MISSING_EXTRA
        case ArgumentRejected():
            code = ExitCode.USAGE
        case StoreError():
            code = ExitCode.STORE
        case NiryoError():
            code = ExitCode.ROBOT
        case OSError() if error.filename:
            code = ExitCode.USAGE
        case _:
            return Failure(
                f"unexpected {type(error).__name__}: {error} (NIRYO_JAX_DEBUG=1 shows where)",
                ExitCode.UNEXPECTED,
            )
    return Failure(str(error), code)


def json_number(value: float) -> float | None:
    """A number for JSON, which has neither infinity nor NaN: null in their place."""
    return float(value) if math.isfinite(value) else None


def print_json(document: Mapping[str, object]) -> None:
    """Write the one JSON document of a command to stdout."""
    print(json.dumps(document, allow_nan=False, indent=2), flush=True)
