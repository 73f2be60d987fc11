"""The examples run as they stand, and their results are those they print."""

from __future__ import annotations

import importlib.util
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import niryo_jax as nj

EXAMPLES = Path(__file__).parent.parent / "examples"


def run(name: str, *arguments: Any) -> Any:
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))["main"](*arguments)


def test_forward_kinematics():
    result = run("01_forward_kinematics")
    np.testing.assert_allclose(
        result.start[:3, 3], [0.09103892112778, 0.0, 0.19052938373525], atol=1e-14
    )
    assert 0.4 < result.farthest < 0.5
    np.testing.assert_allclose(result.twist, [0, 0, 1, 0, 0, 0], atol=1e-15)


def test_batch_inverse_kinematics():
    result = run("02_batch_inverse_kinematics", 200)
    assert result.picked == result.solved == 200
    assert result.largest_error <= 1e-12
    assert result.far is nj.IKStatus.UNREACHABLE


def test_gradients():
    result = run("03_gradients")
    assert result.after > 2 * result.before
    assert np.all(np.isfinite(result.slopes))
    assert np.max(np.abs(result.slopes)) * 1e-4 > 100 * result.miss


@pytest.mark.skipif(importlib.util.find_spec("pyniryo") is None, reason="pyniryo is not installed")
@pytest.mark.filterwarnings("ignore:pyniryo .* is made for:UserWarning")
def test_pick_and_place():
    result = run("04_pick_and_place")
    assert len(result.records) == 10
    np.testing.assert_allclose(result.position, [0.148, 0.148, 0.0], atol=1e-6)
