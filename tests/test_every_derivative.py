"""Every public function: derivatives in both modes, against differences, and always finite."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from derivative_cases import CASES, WITHOUT, contract
from derivatives import (
    Case,
    Derivatives,
    Differentiated,
    Kind,
    directions,
    moved,
    public_functions,
    rate,
)

STEPS = (-2, -1, 1, 2)


def parametrised(slow):
    """Over all cases, of which those of the tiers that are slow are left to `completeness`."""
    marked = {True: pytest.mark.completeness, False: ()}
    return pytest.mark.parametrize(
        "case", [pytest.param(one, id=one.label, marks=marked[one.tier in slow]) for one in CASES]
    )


def test_every_public_function_is_differentiated_or_has_a_reason_not_to_be():
    public, known = set(public_functions()), {case.of for case in CASES}
    assert not public - known - set(WITHOUT), (
        "a case in tests/derivative_cases_*.py, or a reason in WITHOUT, is needed for these"
    )
    assert not (known | set(WITHOUT)) - public, "there are no public functions of these names"
    assert not known & set(WITHOUT)


class Law:
    """A case at its points, along one random direction."""

    def __init__(self, case: Case) -> None:
        rng = np.random.default_rng(8)
        self.case, self.function = case, Differentiated(case)
        self.x = case.arguments(np.float64)
        self.along = directions(case, self.x, rng)
        self.weights = rng.standard_normal((len(case.names), 4096))

    def kinds(self) -> Iterator[tuple[Kind, np.ndarray, np.ndarray]]:
        return zip(self.case.by.values(), self.x, self.along)

    def at(self, dtype: Any = np.float64, step: float = 0.0) -> Derivatives:
        x = [moved(*one, step) for one in self.kinds()] if step else self.case.arguments(dtype)
        u = [np.asarray(rate(*one), dtype) for one in self.kinds()]
        return self.function.at(x, u, self.weights)

    def check_finite(self, found: Derivatives) -> None:
        for name, row in zip(self.case.names, found.rate):
            assert np.all(np.isfinite(row)), f"{name}: forward mode is not finite"
        for name, bar in zip(self.case.by, found.bars):
            assert np.all(np.isfinite(bar)), f"{name}: reverse mode is not finite"
        regular = len(self.case.regular)
        for (name, point), row in zip(self.case.singular.items(), found.rate[regular:]):
            assert point.given != "0" or not np.any(row), f"{name}: {np.abs(row).max()} for 0"
        for name, flag, have in zip(self.case.singular, self.case.flags, found.flag[regular:]):
            assert flag is None or have == flag, f"{name}: flag {have}"

    def close(self, found, expected, counts, most: float, what: str) -> None:
        for i, name in enumerate(self.case.regular):
            off = np.abs(found[i] - expected[i]).max(where=counts[i], initial=0.0)
            off /= 1 + np.abs(expected[i]).max(where=counts[i], initial=0.0)
            assert off < most, f"{name}: {off:.1e} from {what}"


def matched(base, side, joints):
    """Which solutions of another problem are nearest to those of this one: entries (points, m)."""
    base, side = (part.reshape(len(part), -1, joints) for part in (base, side))
    apart = np.abs(np.angle(np.exp(1j * (side[:, None] - base[:, :, None])))).max(axis=-1)
    chosen = np.argmin(apart, axis=-1)
    return (chosen[..., None] * joints + np.arange(joints)).reshape(len(base), -1)


_IN_FLOAT64: dict[str, Derivatives] = {}
"""What the first test found, for the second."""


@parametrised(slow=("slow",))
def test_derivatives(case):
    law = Law(case)
    found = _IN_FLOAT64[case.label] = law.at()
    law.check_finite(found)

    # One mode is the transpose of the other.
    terms = law.weights[:, : found.rate.shape[1]] * found.rate
    backward = sum(np.sum(bar * rate(*one)) for bar, one in zip(found.bars, law.kinds()))
    assert abs(np.sum(terms) - backward) <= 1e-9 * (1 + np.sum(np.abs(terms)))

    sides = [law.at(step=case.step * k).value for k in STEPS]
    if case.joints:
        places = [matched(found.value, side, case.joints) for side in sides]
        sides = [np.take_along_axis(*pair, axis=1) for pair in zip(sides, places)]
    near, far = sides[2] - sides[1], sides[3] - sides[0]
    if case.turns:
        near, far = (np.angle(np.exp(1j * part)) for part in (near, far))
    expected = (8 * near - far) / (12 * case.step)
    law.close(found.rate, expected, found.counts, 1e-6, "finite differences")


@parametrised(slow=("heavy", "slow"))
def test_derivatives_in_float32(case):
    law = Law(case)
    single, double = law.at(np.float32), _IN_FLOAT64.get(case.label) or law.at()
    assert single.rate.dtype == np.float32
    law.check_finite(single)
    rates = single.rate
    if case.joints:
        rates = np.take_along_axis(rates, matched(double.value, single.value, case.joints), axis=1)
    law.close(rates, double.rate, double.counts, case.single, "float64")


def test_the_page_says_what_is_tested():
    page = (Path(__file__).parent.parent / "docs" / "research.md").read_text()
    table = page.split("-->\n")[1].split("<!--")[0]
    assert table.strip() == contract(), "python tests/derivative_cases.py prints the table"
