"""An arm from what was measured of it: simulated arms, the Cramer-Rao bound, differences."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from support import product_of_exponentials

import niryo_jax as nj
from benchmarks import random_arms
from niryo_jax import calibration
from niryo_jax.calibration import motions
from niryo_jax.calibration.least_squares import least_squares
from niryo_jax.calibration.measurements import linearised, measurements_of
from niryo_jax.calibration.parameters import SETS, arm_of, parameters_of

MM = 1e-4, 1e-4
ARM = nj.robots.niryo_one()


def forward(robot, q):
    return np.asarray(product_of_exponentials(robot.screws, robot.home, q), float)


Q = np.linspace(-0.5, 0.5, 60).reshape(10, 6)
POSES = forward(ARM, Q)


def noisy(pose, rng, size):
    turn, shift = rng.normal(size=(2, len(pose), 3)) * size
    out = pose.copy()
    out[:, :3, :3] = pose[:, :3, :3] @ motions.exp(np.pad(turn, ((0, 0), (0, 3))))[:, :3, :3]
    out[:, :3, 3] += shift
    return out


def worn(robot, sets, rng, size=2e-3):
    """An arm with parameters at random: them, their values, and where the tool is at q."""
    chosen = parameters_of(robot, sets, ())
    x = rng.normal(size=len(chosen.free)) * size
    changes = chosen.changes(robot, x)

    def seen(q):
        return forward(arm_of(robot, changes), q * (1 + changes.gears))

    return chosen, x, seen


def joint_vectors(robot, count, rng):
    low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    return rng.uniform(low, high, (count, robot.joints))


def test_the_exponential_and_its_derivative_are_those_of_the_group(rng):
    twist = np.concatenate([rng.normal(size=(20, 6)), 1e-5 * rng.normal(size=(20, 6))])
    np.testing.assert_allclose(motions.exp(twist), nj.se3.exp(twist), atol=1e-15)
    pose = motions.exp(twist)
    np.testing.assert_allclose(motions.adjoint(pose), nj.se3.adjoint(pose), atol=1e-14)
    turns = nj.so3.log(pose[:, :3, :3])
    np.testing.assert_allclose(motions.rotation_vector(pose[:, :3, :3]), turns, atol=1e-13)
    for t, way in zip(0.3 * twist[:5], rng.normal(size=(5, 6))):
        step = 1e-6
        ends = [motions.exp(t + s * step * way) for s in (1, -1)]
        rate = (ends[0] - ends[1]) / (2 * step) @ np.linalg.inv(motions.exp(t))
        np.testing.assert_allclose(nj.se3.vee(rate), motions.left_derivative(t) @ way, atol=1e-8)


@pytest.mark.parametrize("name", ["Rpqwww", "RPPwww", "ppaq"])
def test_derivatives_by_every_parameter_equal_differences(name, rng):
    letters = {v: k for k, v in random_arms.FAMILIES.items()}
    robot = random_arms.arm(letters[name], rng)
    chosen = parameters_of(robot, SETS, ())
    turns = np.sum(np.any(np.asarray(robot.screws)[:, :3], axis=1))
    assert len(chosen.names) == 4 * robot.joints + 2 * turns + 12
    x = rng.normal(size=len(chosen.free)) * 0.1
    q = rng.uniform(-1, 1, (4, robot.joints))
    _, twists = chosen.linearised(robot, x, q)
    step = 1e-6
    for i in range(len(x)):
        ends = [chosen.linearised(robot, x + s * step * np.eye(len(x))[i], q)[0] for s in (1, -1)]
        rate = (ends[0] - ends[1]) / (2 * step)
        rate = rate @ np.linalg.inv(chosen.linearised(robot, x, q)[0])
        np.testing.assert_allclose(nj.se3.vee(rate), twists[..., i], atol=1e-7)


@pytest.mark.parametrize("name", ["Rpqwww", "RPPwww", "ppaq"])
def test_the_fitted_robot_moves_as_its_parameters_say(name, rng):
    letters = {v: k for k, v in random_arms.FAMILIES.items()}
    robot = random_arms.arm(letters[name], rng)
    chosen = parameters_of(robot, SETS, ())
    x = rng.normal(size=len(chosen.free)) * 0.1
    q = rng.uniform(-1, 1, (8, robot.joints))
    changes = chosen.changes(robot, x)
    reached = forward(arm_of(robot, changes), q * (1 + changes.gears))
    np.testing.assert_allclose(reached, chosen.linearised(robot, x, q)[0], atol=1e-13)


@pytest.mark.parametrize("kind", ["pose", "position", "distance"])
def test_residuals_fall_as_the_jacobian_says(kind, rng):
    chosen, x, seen = worn(ARM, ("screws", "home"), rng, 1e-2)
    q = joint_vectors(ARM, 6, rng)
    pose = seen(q)
    places = pose[:, :3, 3]
    values = {"pose": pose, "position": places, "distance": np.linalg.norm(places, axis=1)}
    found = measurements_of(ARM, q, values[kind], None, (1.0, 1.0))
    r, jacobian = linearised(ARM, chosen, found, x)
    np.testing.assert_allclose(r, 0.0, atol=1e-13)
    way = rng.normal(size=len(x))
    step = 1e-6
    ends = [linearised(ARM, chosen, found, x + s * step * way)[0] for s in (1, -1)]
    np.testing.assert_allclose(-(ends[0] - ends[1]) / (2 * step), jacobian @ way, atol=1e-6)


def test_thirty_parameters_are_as_sure_as_can_be_and_as_the_covariance_says(rng):
    chosen, x, seen = worn(ARM, ("screws", "home"), rng)
    assert len(x) == 30
    q = joint_vectors(ARM, 50, rng)
    exact = seen(q)
    found = measurements_of(ARM, q, exact, None, MM)
    jacobian = linearised(ARM, chosen, found, x)[1].reshape(-1, 30)
    bound = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    off = []
    trial = found
    for _ in range(100):
        trial = found._replace(values=noisy(exact, rng, 1e-4))
        best = least_squares(ARM, chosen, trial, "linear")
        assert best.settled
        off.append((best.x - x) / bound)
    fit = calibration.fit(ARM, q, trial.values, sigma=MM)
    np.testing.assert_allclose((fit.values - x) / bound, off[-1], atol=1e-6)
    np.testing.assert_allclose(fit.deviations, bound, rtol=0.25)
    # The spread of 100 trials is known to 7 %, the largest of 30 to twice that.
    spread = np.sqrt(np.mean(np.square(off), axis=0))
    assert np.sqrt(np.mean(np.square(off))) < 1.05
    assert np.all(spread < 1.2)


@pytest.mark.parametrize("measured", ["pose", "position"])
def test_without_noise_the_arm_is_found_and_solved_completely(measured, rng):
    # A marker on axis 6 would not tell where that axis is.
    aside = np.eye(4)
    aside[:3, 3] = 0.05, 0.03, 0.0
    robot = ARM.with_tool(aside)
    _, _, seen = worn(robot, ("screws", "home", "gears"), rng, 5e-3)
    q = joint_vectors(ARM, 60, rng)
    pose = seen(q)
    sets = "screws", "home", "gears"
    turns = tuple(f"tool turn {axis}" for axis in "xyz") if measured == "position" else ()
    given = pose if measured == "pose" else pose[:, :3, 3]
    fit = calibration.fit(robot, q, given, sets, hold=turns)
    other = joint_vectors(ARM, 20, rng)
    reached, wanted = forward(fit.robot, fit.turned(other)), seen(other)
    np.testing.assert_allclose(reached[:, :3, 3], wanted[:, :3, 3], atol=1e-9)
    if measured == "pose":
        np.testing.assert_allclose(reached, wanted, atol=1e-9)
        np.testing.assert_allclose(fit.told(fit.turned(other)), other, atol=1e-15)
        answer = nj.inverse_kinematics(fit.robot, wanted)
        away = np.abs(np.asarray(answer.q) - fit.turned(other)[:, None])
        away = np.minimum(away, np.abs(away - 2 * np.pi)).max(axis=-1)
        assert np.all(np.any((away < 1e-6) & np.asarray(answer.found), axis=1))
        assert np.mean(answer.complete) >= 0.9


def test_the_frame_of_the_instrument_need_not_be_known(rng):
    _, _, seen = worn(ARM, ("offsets", "home"), rng)
    q = joint_vectors(ARM, 40, rng)
    frame = motions.exp(np.array([0.3, -2.0, 1.0, 4.0, -3.0, 2.0]))
    hold = "joint_1 offset", "joint_6 offset"
    fit = calibration.fit(ARM, q, frame @ seen(q), ("offsets", "home", "base"), hold=hold)
    np.testing.assert_allclose(forward(fit.robot, q), frame @ seen(q), atol=1e-9)


def test_distances_alone_tell_offsets(rng):
    hold = "joint_1 offset", "joint_6 offset"
    chosen = parameters_of(ARM, ("offsets",), hold)
    x = rng.normal(size=4) * 1e-2
    q = joint_vectors(ARM, 40, rng)
    origin = np.array([0.4, 0.1, -0.1])
    places = chosen.linearised(ARM, x, q)[0][:, :3, 3]
    far = np.linalg.norm(places - origin, axis=1)
    fit = calibration.fit(ARM, q, far, ("offsets",), hold=hold, origin=origin)
    np.testing.assert_allclose(fit.values, x, atol=1e-9)


@pytest.mark.parametrize("loss", ["huber", "tukey"])
def test_one_in_twenty_wrong_measurements_is_survived(loss, rng):
    _, x, seen = worn(ARM, ("screws", "home"), rng)
    q = joint_vectors(ARM, 100, rng)
    measured = noisy(seen(q), rng, 1e-4)
    wrong = rng.choice(100, 5, replace=False)
    measured[wrong, :3, 3] += rng.normal(size=(5, 3)) * 0.05
    losses = "linear", loss
    fits = {each: calibration.fit(ARM, q, measured, loss=each, sigma=MM) for each in losses}
    off = {each: np.sqrt(np.mean((fit.values - x) ** 2)) for each, fit in fits.items()}
    assert off[loss] < 0.1 * off["linear"]
    robust = fits[loss]
    assert set(wrong) <= set(robust.doubted)
    assert np.sqrt(np.mean(((robust.values - x) / robust.deviations) ** 2)) < 1.6
    assert 0.7 < robust.scale < 1.4
    assert "not believed" in robust.message


def test_what_cannot_be_told_is_named_and_held(rng):
    _, _, seen = worn(ARM, ("screws", "home"), rng)
    q = joint_vectors(ARM, 50, rng)
    measured = noisy(seen(q), rng, 1e-5)
    with pytest.raises(ValueError, match=r"cannot tell .* joint_6 offset - tool turn x"):
        calibration.fit(ARM, q, measured, ("offsets", "home"))
    with pytest.raises(ValueError, match=r"tool turn .; tool turn .; tool turn ."):
        calibration.fit(ARM, q, measured[:, :3, 3])
    whole = calibration.fit(ARM, q, measured, ("offsets", "screws", "home"), redundant="hold")
    least = calibration.fit(ARM, q, measured)
    assert len(whole.combinations) == 6
    assert whole.rank == least.rank == 30
    assert not np.any(whole.identifiable[: ARM.joints])
    np.testing.assert_allclose(forward(whole.robot, q), forward(least.robot, q), atol=1e-7)
    assert least.after.metres < 0.05 * least.before.metres
    assert least.held_out is not None
    assert least.held_out.metres < 3 * least.after.metres
    assert "held out" in least.message


@pytest.mark.parametrize("measured", ["pose", "position"])
def test_configurations_that_are_chosen_tell_more_than_others(measured, rng):
    q = joint_vectors(ARM, 300, rng)
    hold = () if measured == "pose" else tuple(f"tool turn {axis}" for axis in "xyz")
    picked = calibration.informative(ARM, q, 20, measured=measured, hold=hold)
    assert len(set(picked.tolist())) == 20
    chosen = parameters_of(ARM, ("screws", "home"), hold)
    pose = forward(ARM, q)

    def tell(rows):
        values = pose[rows] if measured == "pose" else pose[rows, :3, 3]
        found = measurements_of(ARM, q[rows], values, None, MM)
        jacobian = linearised(ARM, chosen, found, np.zeros(len(chosen.free)))[1]
        return np.linalg.slogdet(np.einsum("nri,nrj->ij", jacobian, jacobian))[1]

    others = [tell(rng.choice(300, 20, replace=False)) for _ in range(20)]
    assert tell(picked) > max(others) + 1


def test_files_are_read_in_their_units(tmp_path, rng):
    q = joint_vectors(ARM, 5, rng)
    pose = forward(ARM, q)
    places = np.degrees(q), pose[:, :3, 3] * 1e3
    quaternion = []
    for rotation in pose[:, :3, :3]:
        w = np.asarray(nj.so3.log(rotation))
        angle = np.linalg.norm(w)
        quaternion.append([np.cos(angle / 2), *(np.sin(angle / 2) * w / angle)])
    heads = [f"joint_{i}_deg" for i in range(1, 7)], ["x_mm", "y_mm", "z_mm"]
    whole = tmp_path / "poses.csv"
    rows = np.concatenate([*places, quaternion], axis=1)
    head = ",".join([*heads[0], *heads[1], "qw", "qx", "qy", "qz"])
    body = "\n".join(",".join(map(repr, row.tolist())) for row in rows)
    whole.write_text(f"# by hand\n{head}\n{body}\n\n", encoding="utf-8")
    table = calibration.read_measurements(whole, ARM)
    np.testing.assert_allclose(table.q, q, atol=1e-14)
    np.testing.assert_allclose(table.measured, pose, atol=1e-14)
    short = tmp_path / "places.csv"
    body = "\n".join(",".join(map(repr, row.tolist())) for row in rows[:, :9])
    short.write_text(",".join([f"q{i}_deg" for i in range(1, 7)] + heads[1]) + "\n" + body)
    np.testing.assert_allclose(
        calibration.read_measurements(short, ARM).measured, pose[:, :3, 3], atol=1e-15
    )


def test_the_command_prints_what_it_found_and_what_it_cannot_tell(tmp_path, cli):
    q = Q + 0.1 * np.sin(np.arange(60.0)).reshape(10, 6)
    places = forward(ARM, q + 0.01)[:, :3, 3] * 1e3
    head = ",".join([*(f"q{i}_rad" for i in range(1, 7)), "x_mm", "y_mm", "z_mm"])
    body = "\n".join(",".join(map(repr, [*a, *b])) for a, b in zip(q.tolist(), places.tolist()))
    path = tmp_path / "data.csv"
    path.write_text(f"{head}\n{body}\n")
    asked = ["calibrate", str(path), "--parameters", "offsets"]
    code, out, _ = cli(*asked, "--hold", "joint_6 offset", "--json")
    found = json.loads(out)
    assert code == 0
    values = [found["parameters"][f"joint_{i} offset"] for i in range(1, 6)]
    np.testing.assert_allclose(values, 0.01, atol=1e-9)
    assert found["residuals"]["after"]["m"] < 1e-9
    code, out, _ = cli(*asked, "--hold", "joint_6 offset")
    assert code == 0
    assert "joint_5 offset" in out
    code, _, err = cli(*asked)
    assert code == 2
    assert "joint_6 offset" in err
    code, _, err = cli("calibrate", tmp_path / "none.csv")
    assert code == 2
    assert "none.csv" in err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "empty file"),
        ("q1_deg\n1", "expected a column joint_2 or q2"),
        ("q1,q2_rad,q3_rad,q4_rad,q5_rad,q6_rad,x_m,y_m,z_m\n" + "1," * 8 + "1", "q1 has no unit"),
        ("q1_rad,q1_deg\n1,2", "two columns are called q1"),
        ("q1_rad,q2_rad\n1", "line 2: expected 2 columns, got 1"),
        (
            ",".join(f"q{i}_rad" for i in range(1, 7)) + ",x_m,y_m,z_m\n" + "0," * 8 + "nothing",
            "line 2: z is no finite number",
        ),
    ],
)
def test_files_that_cannot_be_read_are_told_where(text, words, tmp_path):
    path = tmp_path / "data.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=words):
        calibration.read_measurements(path, ARM)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"q": Q[:4], "measured": POSES[:4]}, "at least 30 measured numbers"),
        ({"q": np.degrees(Q)}, "are they degrees"),
        ({"measured": POSES[:, :3, 3] * 1e3}, "are they millimetres"),
        ({"measured": np.full((10, 3), np.nan)}, "measured: expected finite"),
        ({"measured": POSES[:9]}, r"measured: expected \(10, 4, 4\) poses"),
        ({"measured": POSES * 1.1}, "measured"),
        ({"q": Q[:, :5]}, r"q: expected \(N, 6\)"),
        ({"parameters": ("lengths",)}, "parameters: expected some of"),
        ({"parameters": ()}, "parameters: expected some of"),
        ({"hold": ("joint_9 offset",)}, "hold: expected some of"),
        ({"sigma": (0.0, 1.0)}, "sigma: expected"),
        ({"sigma": 1.0}, r"sigma: expected \(metres, radians\)"),
        ({"loss": "cauchy"}, "loss: expected"),
        ({"held_out": 0.9}, "held_out: expected"),
        ({"origin": [0, 0, 0]}, "origin"),
        ({"redundant": "keep"}, "redundant: expected"),
    ],
)
def test_bad_input_is_named(changes, words):
    given = {"q": Q, "measured": POSES, **changes}
    with pytest.raises(ValueError, match=words):
        calibration.fit(ARM, given.pop("q"), given.pop("measured"), **given)


def test_arguments_of_another_type_are_named():
    with pytest.raises(TypeError, match="one text"):
        calibration.fit(ARM, Q, POSES, "screws")
    with pytest.raises(TypeError, match="robot"):
        calibration.fit("niryo_one", Q, POSES)
    with pytest.raises(ValueError, match="count: expected"):
        calibration.informative(ARM, Q, 11)
    assert dataclasses.is_dataclass(calibration.Calibration)
