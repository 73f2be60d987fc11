"""What every subproblem must make of its recorded cases."""

from __future__ import annotations

from typing import Any

import numpy as np

from niryo_jax.subproblems import SubproblemKind, SubproblemSolutions


def check_known_cases(
    cases: list[dict[str, Any]], answer: SubproblemSolutions, dtype: Any, *, turns: bool = True
) -> None:
    """Number, kind and angles of each case; lengths in place of angles where nothing `turns`."""
    assert answer.angles.dtype == dtype
    angles, valid, kind = (np.asarray(x) for x in (answer.angles, answer.valid, answer.kind))
    for i, case in enumerate(cases):
        tangent = "tangent" in case["tag"] or "delta=0" in case["tag"]
        tolerance = (1e-4 if tangent else 1e-6) if dtype == np.float64 else 3e-2
        if case["count"] == "infinite":
            assert kind[i] == SubproblemKind.INFINITE, case["tag"]
            assert valid[i].tolist() == [True] + [False] * (valid.shape[1] - 1)
            continue
        assert valid[i].sum() == case["count"], case["tag"]
        for solution in case["solutions"]:
            apart = angles[i][valid[i]] - np.array(solution)
            apart = (apart + np.pi) % (2 * np.pi) - np.pi if turns else apart
            assert np.abs(apart).max(axis=-1).min() < tolerance, case["tag"]
        expected = [SubproblemKind.NONE, SubproblemKind.FINITE][case["count"] > 0]
        assert kind[i] == (SubproblemKind.TANGENT if tangent else expected), case["tag"]
