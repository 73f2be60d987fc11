"""Why each of the eight branches of the published method was kept or dropped."""

from __future__ import annotations

import dataclasses

import numpy as np
from rich.table import Table

from niryo_jax.cli.tables import new_table
from niryo_jax.ik import BranchStatus, IKSolutions, SeededBranches


@dataclasses.dataclass(frozen=True)
class Explained:
    """One branch.

    Attributes:
        guess: joint angles of the guess, radians.
        guess_error: metres by which it misses the pose on the true arm.
        iterations: the Newton steps taken from there.
        outcome: what became of it.
        solution: the slot of the solution it gave; None where it gave none.
    """

    guess: list[float]
    guess_error: float
    iterations: int
    outcome: BranchStatus
    solution: int | None

    def as_document(self) -> dict[str, object]:
        """The branch for JSON; solutions are counted from 0 there."""
        return {
            "guess_rad": self.guess,
            "guess_error_m": self.guess_error,
            "newton_iterations": self.iterations,
            "outcome": self.outcome.name,
            "message": self.outcome.message,
            "solution": self.solution,
        }


def explain(branches: SeededBranches, solutions: IKSolutions) -> list[Explained]:
    """The branches of one pose beside its solutions.

    A branch that converged belongs to the solution at which it ended; the published method does not
    find every solution.
    """
    found = np.flatnonzero(np.asarray(solutions.found))
    explained = list[Explained]()
    for branch, end in enumerate(np.asarray(branches.newton.q)):
        outcome, slot = BranchStatus(int(branches.outcome[branch])), None
        if outcome in (BranchStatus.SOLVED, BranchStatus.OUTSIDE_LIMITS) and len(found):
            turns = (np.asarray(solutions.q)[found] - end) / (2 * np.pi)
            slot = int(found[np.argmin(np.max(np.abs(turns - np.round(turns)), axis=-1))])
        explained.append(
            Explained(
                guess=np.asarray(branches.guess[branch]).tolist(),
                guess_error=float(branches.guess_error[branch]),
                iterations=int(branches.newton.iterations[branch]),
                outcome=outcome,
                solution=slot,
            )
        )
    return explained


def explained_table(explained: list[Explained]) -> Table:
    """The branches in words."""
    table = new_table("The eight branches of the Paden-Kahan method")
    table.add_column("", justify="right")
    table.add_column("guess misses by (mm)", justify="right")
    table.add_column("Newton steps", justify="right")
    table.add_column("solution", justify="right")
    table.add_column("outcome")
    for number, branch in enumerate(explained, start=1):
        table.add_row(
            str(number),
            f"{branch.guess_error * 1e3:.3f}",
            str(branch.iterations),
            "" if branch.solution is None else str(branch.solution + 1),
            branch.outcome.message,
        )
    return table
