"""Arguments that are none: every public function names the one that is wrong."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import ml_dtypes
import numpy as np
import pytest

import niryo_jax as nj
from niryo_jax.ik.methods.multistart import solve_multistart
from niryo_jax.ik.methods.sampled import solve_sampled

MODULES = (
    *(nj, nj.so3, nj.se3, nj.subproblems, nj.robots, nj.motion, nj.workspace, nj.ik),
    *(nj.workspace.plots, nj.uncertainty, nj.uncertainty.figures, nj.figures, nj.collision),
)
NIRYO, IIWA = nj.robots.niryo_one(), nj.robots.kuka_iiwa14()
AXIS, POINT, POSE = np.eye(6)[2], np.zeros(3), np.eye(4)

SHAPED: dict[str, Any] = {
    "q": np.zeros(6),
    "q0": np.zeros(6),
    "rates": np.zeros(6),
    "q_ref": np.zeros(6),
    "q_start": np.zeros(6),
    "q_end": np.zeros(6),
    "homes": np.zeros((6, 4, 4)),
    "poses": POSE[None],
    "task_poses": POSE[None],
    "rotations": np.eye(3),
    "velocity": np.zeros(6),
    "twist": np.zeros(6),
    "w": np.zeros(3),
    "matrix": POSE,
    "rotation": np.eye(3),
    "position": np.zeros(3),
    "direction": AXIS[:3],
    "point": POINT,
    "axis": AXIS[:3],
    "tool_axis": AXIS[:3],
    "table": np.zeros((2, 4)),
    **dict.fromkeys(("pose", "start", "end", "pose_p", "pose_k", "base", "tool", "home"), POSE),
    **dict.fromkeys(("screw", "screw_1", "screw_2", "screw_3"), AXIS),
    **dict.fromkeys(("p", "k", "other_start", "other_end", "half_size"), POINT),
    "screws": NIRYO.screws,
    "axes": np.eye(3)[[2, 1]],
    "points": np.zeros((2, 3)),
    "bounds": np.array([[-0.3] * 3, [0.3] * 3]),
    "lower": None,
    "upper": None,
    "covariance": np.eye(6),
    "mean": np.zeros(6),
    "via": np.array([0.1, 0.2, 0.0]),
    **dict.fromkeys(("weights", "rate_limits", "acceleration_limits"), np.ones(6)),
    **dict.fromkeys(("null_motion", "previous_rate"), np.zeros(6)),
}
"""Arrays whose last axes have a shape, by the names of arguments."""

BROADCAST: dict[str, Any] = {
    **dict.fromkeys(("duration", "distance", "dt", "threshold"), 1.0),
    **dict.fromkeys(("t", "damping", "pitch", "arm_angle"), 0.0),
    "sigma": 0.1,
    "key": jax.random.key(0),
}
"""Arrays of any shape."""

OTHERS: dict[str, Any] = {
    "robot": NIRYO,
    "samples": 5,
    "radius": 0.1,
    "limits": nj.motion.niryo_limits(),
    "voxel": 0.1,
    "map": None,
    "model": nj.collision.niryo_one(),
    "noise": nj.uncertainty.Uniform(0.1),
    "propagated": nj.uncertainty.Propagated(np.eye(6), np.eye(3), np.zeros(3), "tool_point"),
    "solutions": jax.eval_shape(nj.inverse_kinematics, NIRYO, jax.ShapeDtypeStruct((4, 4), float)),
}
"""What is no array."""

OF_FUNCTION: dict[str, dict[str, Any]] = {
    "motion.best_path": {"poses": np.stack([POSE, POSE])},
    "motion.blend": {"poses": np.stack([POSE, np.eye(4) + 0.1 * np.eye(4, k=3)])},
    "motion.retime": {"path": np.zeros((3, 6)), "pace": np.ones(2)},
    "uncertainty.position_ellipsoid": {"covariance": np.eye(3)},
    "collision.segment_distance": {"start": POINT, "end": POINT},
    "collision.box_distance": {"start": POINT, "end": POINT},
    "so3.vee": {"matrix": np.eye(3)},
    "so3.project": {"matrix": np.eye(3)},
    "niryo_jax.arm_angle": {"robot": IIWA, "q": np.zeros(7)},
    "ik.arm_angle": {"robot": IIWA, "q": np.zeros(7)},
    "niryo_jax.inverse_kinematics": {"robot": IIWA},
    "ik.inverse_kinematics": {"robot": IIWA},
}


def functions() -> Iterator[tuple[str, Any]]:
    """Every public function of arrays and numbers by a short name, and the methods of a robot."""
    for module in MODULES:
        short = module.__name__.rsplit(".", 1)[-1]
        listed = getattr(module, "__all__", None) or [
            name
            for name, value in vars(module).items()
            if getattr(value, "__module__", None) == module.__name__
        ]
        for name in listed:
            function = getattr(module, name)
            if name.startswith("_") or not callable(function) or isinstance(function, type):
                continue
            yield f"{short}.{name}", function
    for name in ("from_screws", "from_body_screws", "from_axes"):
        yield f"Robot.{name}", getattr(nj.Robot, name)
    yield "Robot.with_tool", NIRYO.with_tool


def cases() -> Iterator[Any]:
    """Every function with every array that it takes."""
    for name, function in functions():
        parameters = inspect.signature(function).parameters.values()
        if any(parameter.annotation in ("Lane", "Lanes") for parameter in parameters):
            continue
        samples = {**SHAPED, **BROADCAST, **OTHERS, **OF_FUNCTION.get(name, {})}
        needed = [p.name for p in parameters if p.default is p.empty]
        for parameter in parameters:
            if "ArrayLike" not in str(parameter.annotation):
                continue
            assert parameter.name in samples, f"{name}: no sample of {parameter.name}"
            given = {key: samples[key] for key in needed if key in samples}
            yield pytest.param(name, function, given, parameter, id=f"{name}-{parameter.name}")


@pytest.mark.parametrize(("name", "function", "given", "parameter"), list(cases()))
def test_an_array_that_is_none_is_named(name, function, given, parameter):
    bad = ["abc", object(), {"a": 1}, [[1.0], [2.0, 3.0]], np.array(["a"]), 1j * np.ones(6)]
    if parameter.default is not None:
        bad.append(None)
    shaped = parameter.name in SHAPED
    sample = SHAPED.get(parameter.name)
    sample = np.zeros(6) if sample is None else sample
    for dtype in (np.float16, ml_dtypes.bfloat16):
        bad += [np.asarray(sample, dtype), jnp.asarray(sample, dtype)]
    if shaped:
        bad += [np.zeros((5, 11)), jnp.zeros((5, 11)), np.float64(1.0)]
    between = "motion.joint_trajectory", "motion.point_to_point"
    if name in between and parameter.name == "q_start":
        bad = [value for value in bad if getattr(value, "size", 0) != 55]  # any number of joints
    for value in bad:
        with pytest.raises((TypeError, ValueError)) as error:
            function(**{**given, parameter.name: value})
        names = re.match(r"([\w, ]+): expected ", str(error.value))
        assert names, f"{value!r}: {error.value}"
        assert parameter.name in names[1].split(", ")


OPTIONS = {
    **dict.fromkeys(("robot", "map", "comparison", "spec", "figure", "store", "path"), ()),
    **dict.fromkeys(
        ("method", "frame", "part", "kind", "convention", "up", "edition"), ("zz", 3.5)
    ),
    **dict.fromkeys(("length", "step_limit", "position_tolerance", "voxel", "largest_step"), (-1,)),
    **dict.fromkeys(("samples", "number", "max_iterations", "seed", "first", "rolls"), (-1, 1.5)),
    "locked": (3, (1,), ("a", 0.0), (9, 0.0), (0, "abc")),
    "scaling": ("abc", 5j),
    **dict.fromkeys(("noise", "solutions", "propagated", "trials"), ("zz",)),
    "percentiles": ("95", (101,), 5),
    "probability": ("a", 2.0, np.nan),
    "home": ("zz",),
    **dict.fromkeys(("tool", "model", "world"), ("zz",)),
    "name": (),
}
"""Arguments that are no arrays, and what else than an object and None they may not be."""


def options() -> Iterator[Any]:
    """Every function with every argument that is no array, of those above."""
    for name, function in functions():
        parameters = inspect.signature(function).parameters.values()
        samples = {**SHAPED, **BROADCAST, **OTHERS, "path": "<robot/>", **OF_FUNCTION.get(name, {})}
        if name.startswith(("Robot.", "robots.from_")):
            continue
        for parameter in parameters:
            wrong = OPTIONS.get(parameter.name)
            if wrong is None or "ArrayLike" in str(parameter.annotation).replace("Locked", ""):
                continue
            required = [p.name for p in parameters if p.default is p.empty]
            given = {key: samples.get(key) for key in required}
            wrong = (*wrong, object(), *([None] if parameter.default is parameter.empty else []))
            yield pytest.param(
                function, given, parameter.name, wrong, id=f"{name}-{parameter.name}"
            )


@pytest.mark.parametrize(("function", "given", "argument", "wrong"), list(options()))
def test_an_option_that_is_none_is_named(function, given, argument, wrong):
    if given.get("map", 0) is None and argument != "map":
        pytest.skip("takes a map to be asked")
    for value in wrong:
        with pytest.raises((TypeError, ValueError)) as error:
            function(**{**given, argument: value})
        assert re.match(rf"{argument}: ", str(error.value)), f"{value!r}: {error.value}"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"screws": "abc"}, "screws: expected an array of numbers, got 'abc'"),
        ({"screws": None}, "screws: expected an array of numbers, got None"),
        ({"screws": np.zeros((6, 6))}, r"screws: expected \|omega\| = 1"),
        ({"screws": np.full((6, 6), np.nan)}, "screws: expected finite numbers"),
        ({"screws": np.eye(6, dtype=bool)}, "screws: expected real numbers, got dtype bool"),
        ({"screws": np.eye(6) * 1j}, "screws: expected real numbers, got dtype complex128"),
        (
            {"screws": np.eye(6)[:, :5]},
            r"screws: expected shape \(n, 6\) with n >= 1, got \(6, 5\)",
        ),
        ({"screws": np.eye(6)[:5]}, r"lower: expected shape \(5,\), got \(6,\)"),
        (
            {"screws": np.eye(6, dtype=np.float16)},
            "screws: expected float32 or float64, got float16",
        ),
        (
            {"home": jnp.eye(4, dtype=jnp.bfloat16)},
            "home: expected float32 or float64, got bfloat16",
        ),
        ({"home": np.eye(3)}, r"home: expected shape \(4, 4\), got \(3, 3\)"),
        ({"home": jnp.diag(jnp.array([1.0, 1, -1, 1]))}, "home: expected a rigid motion"),
        ({"home": np.full((4, 4), np.inf)}, "home: expected a rigid motion"),
        ({"lower": 1.0}, r"lower: expected shape \(6,\), got \(\)"),
        ({"lower": ["a"] * 6}, "lower: expected an array of numbers"),
        ({"upper": np.full(6, np.nan)}, "upper: expected numbers, got"),
        ({"lower": np.full(6, 9.0)}, "lower must not exceed upper"),
        ({"upper": jnp.full(6, -9.0)}, "lower must not exceed upper"),
        ({"joint_names": "abcdef"}, "joint_names: expected 6 texts, got 'abcdef'"),
        ({"joint_names": ("a", "b")}, "joint_names: expected 6 names, got 2"),
        ({"joint_names": (1, 2, 3, 4, 5, 6)}, "joint_names: expected a text, got 1"),
        ({"name": 5}, "name: expected a text, got 5"),
        ({"assumed": "arm"}, "assumed: expected a structure or None, got 'arm'"),
    ],
)
def test_a_robot_of_garbage_is_refused_however_it_is_built(change, message):
    arrays = {name: getattr(NIRYO, name) for name in ("screws", "home", "lower", "upper")}
    with pytest.raises((TypeError, ValueError), match=message):
        dataclasses.replace(NIRYO, **change)
    with pytest.raises((TypeError, ValueError), match=message):
        nj.Robot(**{**arrays, **change})
    if "assumed" not in change:
        with pytest.raises((TypeError, ValueError), match=message):
            nj.Robot.from_screws(**{**arrays, **change})


def test_integers_and_lists_make_a_robot():
    screws, home = [[0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 0, 0]], np.eye(4, dtype=int)
    for robot in (
        nj.Robot.from_screws(screws, home, lower=[-1, 0], upper=[1, 2]),
        nj.Robot(screws, home, [-1, 0], jnp.array([1, 2])),
    ):
        assert robot.joint_names == ("joint_1", "joint_2")
        assert all(jnp.issubdtype(x.dtype, jnp.floating) for x in jax.tree.leaves(robot))
        np.testing.assert_allclose(nj.forward_kinematics(robot, [0, 1])[:3, 3], [1, 0, 0])


def test_an_array_that_changes_later_does_not_change_the_robot():
    screws = np.array(NIRYO.screws)
    robot = dataclasses.replace(NIRYO, screws=screws)
    screws[:] = 0
    np.testing.assert_array_equal(robot.screws, NIRYO.screws)


@pytest.mark.parametrize("leaf", [object(), None, 0, 1.5, "abc", jax.ShapeDtypeStruct((), float)])
def test_what_jax_puts_in_place_of_arrays_is_not_looked_at(leaf):
    leaves, tree = jax.tree.flatten(NIRYO)
    robot = jax.tree.unflatten(tree, [leaf] * len(leaves))
    assert robot.screws is leaf
    assert jax.tree.structure(jax.tree.map(lambda _: 0, NIRYO)) == tree


def test_traced_arrays_and_shapes_make_robots():
    q = np.full(6, 0.3)

    def pose(screws, home):
        return nj.forward_kinematics(dataclasses.replace(NIRYO, screws=screws, home=home), q)

    shapes = [jax.ShapeDtypeStruct(x.shape, float) for x in (NIRYO.screws, NIRYO.home)]
    assert jax.eval_shape(pose, *shapes).shape == (4, 4)
    dataclasses.replace(NIRYO, screws=shapes[0])
    # Twice as long a screw is no unit screw, but an optimiser may pass through it.
    assert np.all(np.isfinite(jax.jit(pose)(2 * NIRYO.screws, NIRYO.home)))
    with pytest.raises(ValueError, match=r"home: expected shape \(4, 4\), got \(3, 3\)"):
        jax.jit(pose)(NIRYO.screws, np.eye(3))
    with pytest.raises(TypeError, match="screws: expected float32 or float64, got float16"):
        jax.jit(pose)(NIRYO.screws.astype(np.float16), NIRYO.home)


def test_half_precision_is_refused_where_it_is_traced():
    solve = jax.jit(lambda q: nj.forward_kinematics(NIRYO, q))
    for dtype in (jnp.float16, jnp.bfloat16):
        with pytest.raises(TypeError, match=r"^q: expected float32 or float64, got "):
            solve(jnp.zeros(6, dtype))


def test_batch_axes_that_do_not_fit_are_named():
    poses, q = np.zeros((2, 4, 4)), np.zeros((3, 6))
    for function, names in (
        (lambda: nj.newton_raphson(NIRYO, poses, q), "pose, q0"),
        (lambda: nj.tool_velocity(NIRYO, q, q[:2]), "q, sin|q, .*rates"),
        (
            lambda: nj.se3.from_rotation_and_position(poses[:, :3, :3], q[:, :3]),
            "rotation, position",
        ),
        (lambda: nj.motion.joint_trajectory(q, q[:2], 1.0, 5), "q_start, q_end"),
        (lambda: nj.inverse_kinematics(IIWA, poses, arm_angle=q[:, 0]), "pose, arm_angle"),
    ):
        with pytest.raises(ValueError, match=rf"^({names}).*: expected batch axes"):
            function()


@pytest.mark.parametrize(
    ("function", "name"),
    [
        (lambda n: nj.motion.joint_trajectory(np.zeros(6), np.ones(6), 1.0, n), "samples"),
        (lambda n: nj.motion.screw_trajectory(POSE, POSE, 1.0, n), "samples"),
        (lambda n: nj.motion.cartesian_trajectory(POSE, POSE, 1.0, n, "cubic"), "samples"),
        (lambda n: nj.workspace.orientations(n), "number"),
        (lambda n: nj.workspace.orientations(n, "random"), "number"),
        (lambda n: nj.workspace.orientations(n, "directions"), "number"),
        (lambda n: nj.workspace.joint_samples(NIRYO, n), "samples"),
        (lambda n: nj.workspace.joint_samples(NIRYO, 1, first=n), "first"),
        (lambda n: nj.newton_raphson(NIRYO, POSE, np.zeros(6), max_iterations=n), "max_iterations"),
        (lambda n: solve_multistart(NIRYO, POSE, n), "starts"),
        (lambda n: solve_sampled(IIWA, POSE, n), "samples"),
    ],
)
def test_a_count_is_a_whole_number_for_which_there_is_room(function, name):
    for value in (10**11 if name != "first" else 10**20, 10**30):
        with pytest.raises(ValueError, match=rf"^{name}: expected at most \d+"):
            function(value)
    for value in ("abc", None, 2.5, object(), np.zeros(3), POSE):
        with pytest.raises(TypeError, match=rf"^{name}: expected an integer, got"):
            function(value)
    with pytest.raises(ValueError, match=rf"^{name}: expected \d or more, got -1"):
        function(-1)
