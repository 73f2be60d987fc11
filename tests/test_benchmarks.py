"""The benchmark's own gate: every answer it times is right."""

from __future__ import annotations

from benchmarks.core import measure, table


def test_every_timed_answer_is_right():
    times, right = measure(poses=256, runs=1)
    assert all(right.values()), right
    assert table(times).count("\n") == len(times) + 1
