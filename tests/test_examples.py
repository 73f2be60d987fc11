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


@pytest.mark.skipif(importlib.util.find_spec("pyniryo") is None, reason="pyniryo is not installed")
@pytest.mark.filterwarnings("ignore:pyniryo .* is made for:UserWarning")
def test_timed_pick_and_place(tmp_path):
    picture = tmp_path / "timed.png"
    drawing = importlib.util.find_spec("matplotlib") is not None
    result = run("23_timed_pick_and_place", *([picture] if drawing else []))
    assert result.timed.duration == pytest.approx(12.14, abs=5e-3)
    assert result.off < 1e-9
    assert result.clearance == pytest.approx(2.9e-3, abs=5e-5)
    np.testing.assert_allclose(result.position, [0.148, 0.148, 0.0], atol=1e-6)
    assert picture.exists() == drawing


def test_puma_type():
    result = run("05_puma_type")
    assert (result.count, result.complete) == (8, True)
    assert result.distance < 5e-4
    assert result.numeric_miss == pytest.approx(0.434, abs=1e-3)
    assert result.numeric_turn == pytest.approx(0.95, abs=5e-3)


def test_gantry():
    result = run("06_gantry")
    assert (result.counts, result.complete) == ({4}, True)
    assert result.slide_error < 1e-12
    assert result.nearest_error < 1e-9


def test_scara():
    result = run("07_scara")
    assert result.counts == {2}
    np.testing.assert_allclose(sorted(result.elbows), [-60, 60])
    status = nj.IKStatus
    assert result.statuses == (status.UNREACHABLE, status.UNREACHABLE, status.OUTSIDE_LIMITS)


def test_ur_type():
    result = run("08_ur_type")
    assert set(result.counts) <= {2, 4, 6, 8}
    assert result.solved == sum(result.counts.values()) == 500
    assert result.largest_error <= 1e-12
    assert result.largest_step <= 0.1 + 1e-9


def test_redundant_arm():
    result = run("09_redundant_arm")
    assert result.solutions.shape == (16, 7)
    apart = np.abs(result.solutions[:, None] - result.solutions).max(axis=-1)
    assert np.min(apart + 9 * np.eye(16)) > 1e-2
    assert result.largest_error <= 1e-12
    assert result.family > 100
    assert result.margin > 0.5


def test_differential_kinematics():
    result = run("10_differential_kinematics")
    np.testing.assert_allclose(result.velocity, [0, -0.92, 0, 0.14, 0, -0.23], atol=1e-3)
    assert result.round_trip < 1e-12
    assert result.fastest[2] > 1000
    assert np.all(result.damped < 3)
    assert np.all(result.error < 0.25)


@pytest.mark.skipif(
    any(importlib.util.find_spec(needed) is None for needed in ("xarray", "zarr")),
    reason="the extra workspace is not installed",
)
def test_capability_map(niryo):
    result = run("11_capability_map", 0.1, 24)
    assert result.undecided == 0
    assert result.volume.lower < result.volume.value < result.volume.upper
    # The tool stays within 0.46 m of the axis of joint 1: less than a ball of half a metre.
    assert 0.2 < result.volume.value < 4 / 3 * np.pi * 0.5**3
    best = result.placements
    np.testing.assert_allclose(best.position[0], [0.7, 0.5, 0.0], atol=1e-9)
    assert np.all(best.reached[0])
    solutions = nj.inverse_kinematics(niryo, np.linalg.inv(best.base[0]) @ result.tasks)
    assert np.all(np.any(solutions.within_limits, axis=-1))
    if result.picture is not None:
        assert result.picture.read_bytes().startswith(b"\x89PNG")


def test_joint_errors(tmp_path):
    drawing = importlib.util.find_spec("matplotlib") is not None
    picture = tmp_path / "errors.png" if drawing else None
    result = run("12_joint_errors", picture)
    np.testing.assert_allclose(result.zyz, [[0, 90, 0]] * 2, atol=1e-9)
    np.testing.assert_allclose(result.rms, [3.85, 3.97], atol=5e-3)
    np.testing.assert_allclose(result.averaged * np.sqrt(200), result.rms)
    assert np.all(np.linalg.norm(result.tests, axis=-1) < 1)
    np.testing.assert_allclose(result.half_axes, result.drawn_half_axes, rtol=5e-3)
    np.testing.assert_array_equal(np.argmax(result.alone, axis=-1), [2, 2])
    assert np.all(result.agrees)
    assert result.least == pytest.approx(3.85e-3, abs=5e-6)
    if picture is not None:
        assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.skipif(importlib.util.find_spec("pyniryo") is None, reason="pyniryo is not installed")
@pytest.mark.filterwarnings("ignore:pyniryo .* is made for:UserWarning")
def test_block_stacking(tmp_path):
    picture = tmp_path / "blocks.png"
    drawing = importlib.util.find_spec("matplotlib") is not None
    result = run("13_block_stacking", 1, *([picture] if drawing else []))
    assert (result.before, result.after) == ([0], [4])
    assert result.off[0] < 0.6
    assert picture.exists() == drawing


def test_calibration(tmp_path):
    picture = tmp_path / "calibration.png"
    drawing = importlib.util.find_spec("matplotlib") is not None
    result = run("14_calibration", *([picture] if drawing else []))
    assert {7, 23, 41} <= set(result.fit.doubted)
    assert result.spread < 1.5
    assert result.sharper > 1.0
    assert "joint_6 offset - tool turn x" in result.combinations
    assert result.solved >= 195
    assert result.off < 5e-4
    assert picture.exists() == drawing


def test_collision():
    result = run("15_collision")
    assert result.clear == (4, 4)
    assert result.all_collide
    assert result.before < 0 < 0.02 <= result.after
    assert result.moved < 20


def test_timed_path(tmp_path):
    picture = tmp_path / "motion.png"
    drawing = importlib.util.find_spec("matplotlib") is not None
    result = run("16_timed_path", *([picture] if drawing else []))
    times = result.durations
    assert times["fastest"] < times["smooth"]
    assert times["careful"] > 0.3 / 0.1
    assert max(result.shares) == pytest.approx(1.0, abs=1e-3)
    assert result.off < 1e-9
    assert result.samples == 1 + np.ceil(1e3 * times["fastest"])
    assert picture.exists() == drawing


def test_velocity_loop():
    result = run("17_velocity_loop")
    assert result.kept
    assert result.singular < 1e-3
    assert result.unlimited > 30
    assert sum(result.statuses.values()) == 801
    assert result.statuses["REACHED"] > 400
    assert result.statuses["LIMITED"] > 20
    assert result.strays[0] < 40
    assert result.ends[0] < 1
    assert result.ends[1] < 0.1


def test_base_placement():
    pytest.importorskip("optax")
    result = run("18_base_placement")
    assert result.reached == (9, 9)
    assert result.after > result.before + np.deg2rad(10)


def test_tool_design():
    pytest.importorskip("optax")
    result = run("19_tool_design")
    assert result.reached[0] < 12 == result.reached[1]
    assert result.worst > 1.5 * result.first_whole > 0
    assert result.off < 1e-12


def test_learned_inverse_kinematics():
    pytest.importorskip("optax")
    result = run("20_learn_inverse_kinematics")
    assert result.after < 0.005 < 0.05 < result.before
    assert result.polished < 1e-5


def test_around_a_sphere(tmp_path):
    pytest.importorskip("optimistix")
    pytest.importorskip("optax")
    picture = tmp_path / "path.png"
    drawing = importlib.util.find_spec("matplotlib") is not None
    result = run("21_around_a_sphere", *([picture] if drawing else []))
    assert result.before < -0.02
    assert min(result.adam, result.verified) > 0.015
    assert result.ratio < 0.5
    assert picture.exists() == drawing


def test_hand_eye():
    pytest.importorskip("optimistix")
    result = run("22_hand_eye")
    assert result.before > 0.05
    assert np.all(np.abs(result.off) < 4 * result.deviations)
    assert 0.8 < result.left < 1.2
