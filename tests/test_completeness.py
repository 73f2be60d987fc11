"""Inverse kinematics finds every solution and nothing else: laws, judged by exhaustive search.

Each law runs on small sets of poses, and with `pytest -m completeness` on large ones, whose
figures are printed. What belongs to one robot and one set of poses is solved once, in `case`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import exhaustive as judge
import numpy as np
import pose_sets as sets
import pytest
from support import BATCHES, product_of_exponentials

import niryo_jax as nj
from niryo_jax.ik import IKStatus

CLOSES = {np.float64: 1e-12, np.float32: 1e-6}
"""An answer may miss its pose by this, metres and radians, and by the rounding of its angles."""

SAME = 1e-6
"""Two answers closer than this in every joint, modulo 2 pi, are duplicates."""

UNPROVED = 1e-3
"""The share of poses of a hard set for which the answer may say that it is not complete: within
1e-9 m of axis 1 and at once within 1e-8 of a double root, solutions are a continuum to rounding.
Everywhere else it says that it is, and is."""

LIMIT = 1e-9
"""A joint beyond its limit by less than this is at its limit."""

Maker = Callable[[nj.Robot, np.random.Generator], np.ndarray]


@dataclasses.dataclass(frozen=True)
class Case:
    """One robot, one set of poses, the judge's solutions and the solver's.

    `kind` is the name of the set; `q` are the joint vectors (n, 6) that made the poses (n, 4, 4),
    or None; `answer` holds the fields of `IKSolutions` as numpy arrays.
    """

    name: str
    kind: str
    full: bool
    arm: nj.Robot
    q: np.ndarray | None
    poses: np.ndarray
    truth: judge.Solutions
    answer: dict[str, np.ndarray]

    def say(self, record_property: Any, text: str) -> None:
        """Keep a figure of a large run for the end of it."""
        if self.full:
            record_property("figure", f"{self.name}: {text}")


def answers(arm: nj.Robot, poses: np.ndarray) -> dict[str, np.ndarray]:
    """The default method on poses (n, 4, 4), in blocks of one size, so that it compiles once."""
    block = 256 if len(poses) <= 1024 else 2048
    padded = np.concatenate([poses, np.broadcast_to(poses[:1], (-len(poses) % block, 4, 4))])
    parts = [nj.inverse_kinematics(arm, part) for part in np.split(padded, len(padded) // block)]
    names = (
        *("q", "found", "within_limits", "status", "count"),
        *("position_error", "rotation_error", "complete"),
    )
    return {
        name: np.concatenate([np.asarray(getattr(part, name)) for part in parts])[: len(poses)]
        for name in names
    }


# Every case: robot, set, (small, full) numbers of poses, how its joint vectors are made.


def _uniform(n: int) -> Maker:
    return lambda arm, rng: sets.in_limits(arm, n, rng)


def _hard(name: str, n: int) -> Maker:
    def make(arm: nj.Robot, rng: np.random.Generator) -> np.ndarray:
        return np.concatenate([sets.HARD[name](arm, n, delta, rng) for delta in sets.DELTAS])

    return make


def _counted(count: int, n: int) -> Maker:
    return lambda arm, rng: sets.with_count(arm, count, n, rng)


def _cases() -> list[Any]:
    out = list[Any]()

    def add(scale: str, robot: str, name: str, make: Maker, seed: int) -> None:
        marks = [pytest.mark.completeness] if scale == "full" else []
        out.append(
            pytest.param(
                (scale, robot, name, make, seed), marks=marks, id=f"{scale}-{robot}-{name}"
            )
        )

    for robot in sets.NAMED:
        add("small", robot, "random", _uniform(200), 1)
        add("full", robot, "random", _uniform(20000 if robot == "niryo_one" else 5000), 2)
        for hard in sets.HARD:
            if robot in ("niryo_one", "spherical"):
                add("small", robot, hard, _hard(hard, 25), 3)
            add("full", robot, hard, _hard(hard, 2000 if robot == "niryo_one" else 500), 4)
    for count in (10, 12, 14, 16):
        add("small", "niryo_one", f"count_{count}", _counted(count, 20), 5)
        for robot in ("niryo_one", "niryo_ned", "niryo_ned2"):
            add("full", robot, f"count_{count}", _counted(count, 200), 6)
    for robot in sets.RELATIVES:
        if robot in ("all_at_once", "all_spherical"):
            add("small", robot, "random", _uniform(60), 7)
        add("full", robot, "random", _uniform(500), 8)
    return out


@pytest.fixture(scope="module", params=_cases())
def case(request: Any) -> Case:
    """Every reachable set in turn; all laws run on one before the next is solved."""
    scale, name, kind, make, seed = request.param
    arm = sets.robot(name)
    q = make(arm, np.random.default_rng(seed))
    poses = sets.poses_of(arm, q)
    truth = sets.solve(arm, poses, starts=12 if scale == "full" else 6)
    return Case(f"{name} {kind}", kind, scale == "full", arm, q, poses, truth, answers(arm, poses))


# Comparing sets of solutions.


def allowed(singular: np.ndarray, dtype: Any = np.float64) -> np.ndarray:
    """How far an answer may be from the judge's solution, radians.

    The pose is rounded, so near a singularity its solutions are only known to that rounding over
    the least singular value; and two solutions closer than `judge.MERGE` count as one.
    """
    if dtype == np.float32:
        rounding = float(np.finfo(np.float32).eps)
        return np.maximum(1e-3, np.minimum(200 * rounding / np.maximum(singular, 1e-300), 0.1))
    return np.maximum(judge.MERGE, judge.spread(singular))


def gaps(a: np.ndarray, found: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(n, J) for b (n, J, 6): the distance to the nearest of a (n, K, 6) that is found."""
    out = np.full(b.shape[:2], np.inf)
    for slot in range(a.shape[1]):
        distance = judge.apart(b, a[:, slot, None])
        out = np.where(found[:, slot, None], np.minimum(out, distance), out)
    return out


def least_singular(arm: nj.Robot, q: np.ndarray) -> np.ndarray:
    """(n,) the least singular value of the Jacobian at q (n, 6)."""
    jacobian = judge.forward(judge.Geometry.of(arm.screws), np.asarray(arm.home), q)[2]
    return np.linalg.svd(jacobian, compute_uv=False)[:, -1]


def what_is_near(arm: nj.Robot, q: np.ndarray) -> str:
    """What a solution (6,) is close to."""
    geometry = judge.Geometry.of(arm.screws)
    bend = q[2] - np.angle(judge.Elbow.of(geometry).straight)
    third = judge.rodrigues(geometry.axis[2], q[2]) @ (geometry.wrist - geometry.point[2])
    arm_vector = geometry.point[2] - geometry.shoulder + third
    along = judge.rodrigues(geometry.axis[1], q[1]) @ arm_vector
    rho = np.linalg.norm(np.cross(along, geometry.axis[0]))
    sixth = judge.rodrigues(geometry.axis[4], q[4]) @ geometry.axis[5]
    parallel = np.linalg.norm(np.cross(geometry.axis[3], sixth))
    return (
        f"least singular value {least_singular(arm, q[None])[0]:.1e}; sin(elbow)"
        f" {np.sin(bend):.1e}; wrist point {rho:.1e} m from axis 1; sin(axes 4, 6) {parallel:.1e}"
    )


def listing(case: Case, wrong: np.ndarray, q: np.ndarray, most: int = 10) -> str:
    """The poses and solutions q (n, K, 6) that are `wrong` (n, K), a few of them in full."""
    lines = [f"{case.name}: {wrong.sum()} solutions, {len(case.poses)} poses in all"]
    for row, slot in list(zip(*np.nonzero(wrong)))[:most]:
        made = None if case.q is None else case.q[row].tolist()
        lines += [
            f"pose {row}: {case.poses[row, :3].tolist()}",
            f"  made by {made}",
            f"  solution {q[row, slot].tolist()}",
            f"  {what_is_near(case.arm, q[row, slot])}",
        ]
    return "\n".join(lines)


def misses(arm: nj.Robot, q: np.ndarray, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """By how much q (n, 6) misses the poses (n, 4, 4), in extended precision: metres, radians."""
    position, rotation = [np.zeros(0)], [np.zeros(0)]
    for part in np.array_split(np.arange(len(q)), max(1, len(q) // 8192)):
        reached = product_of_exponentials(arm.screws, arm.home, q[part])
        apart = (reached - poses[part])[:, :3]
        position.append(np.sqrt((apart[..., 3] ** 2).sum(axis=-1)).astype(float))
        # |R - R'| (Frobenius) = 2 sqrt(2) sin(angle / 2)
        chord = np.sqrt((apart[..., :3] ** 2).sum(axis=(-1, -2)).astype(float) / 8)
        rotation.append(2 * np.arcsin(np.minimum(chord, 1.0)))
    return np.concatenate(position), np.concatenate(rotation)


def rounding_of(q: np.ndarray) -> np.ndarray:
    """(n,) what half a unit in the last place of each angle can move the tool, radians.

    The arms reach less than a metre, so it bounds metres too. Nothing to speak of in float64.
    """
    return np.spacing(np.abs(q)).astype(float).sum(axis=-1) / 2


# Laws of reachable poses.


def test_every_solution_is_found(case, record_property):
    known, answer = case.truth, case.answer
    gap = gaps(answer["q"], answer["found"], known.q)
    missed = known.found & ~(gap < allowed(known.singular))
    total = known.found.sum()
    histogram = dict(zip(*np.unique(known.count, return_counts=True)))
    case.say(
        record_property,
        f"{total - missed.sum()} of {total} solutions of {len(case.poses)} poses found"
        f" ({1 - missed.sum() / total:.4%}); complete on {1 - missed.any(axis=1).mean():.4%};"
        f" poses by number of solutions { {int(k): int(v) for k, v in histogram.items()} }",
    )
    if missed.any():
        case.say(record_property, "missed: " + listing(case, missed, known.q))
    proved = answer["complete"][:, None]
    assert not (missed & proved).any(), listing(case, missed & proved, known.q)


def test_nearly_every_answer_is_proved_complete(case, record_property):
    share = np.mean(~case.answer["complete"])
    case.say(record_property, f"{share:.4%} of the answers are not proved complete")
    assert share <= (UNPROVED if case.kind in sets.HARD else 0.0)


def test_the_judge_knows_every_answer(case, record_property):
    known, answer = case.truth, case.answer
    gap = np.full(answer["found"].shape, np.inf)
    for slot in range(known.q.shape[1]):
        distance = judge.apart(answer["q"], known.q[:, slot, None])
        near = distance / allowed(known.singular[:, slot, None])
        gap = np.where(known.found[:, slot, None], np.minimum(gap, near), gap)
    # Where solutions are a continuum the judge holds a few of them.
    unknown = answer["found"] & ~(gap < 1) & answer["complete"][:, None]
    case.say(record_property, f"{unknown.sum()} answers unknown to the judge")
    assert not unknown.any(), listing(case, unknown, answer["q"])


def test_the_generating_joint_vector_is_found(case, record_property):
    # Within 1e-6. Solutions that may count as one lie where the least singular value is as small
    # as they are close; there, within that, or what rounding of the pose explains.
    gap = gaps(case.answer["q"], case.answer["found"], case.q[:, None])
    singular = least_singular(case.arm, case.q)
    tolerance = np.where(singular < judge.MERGE, allowed(singular), SAME)[:, None]
    case.say(record_property, f"{np.sum(~(gap < tolerance))} generating joint vectors lost")
    regular = (tolerance <= SAME) & (gap < tolerance)
    case.say(record_property, f"the others within {np.max(gap, where=regular, initial=0):.1e} rad")
    assert np.all(gap < tolerance), listing(case, ~(gap < tolerance), case.q[:, None])


def test_every_answer_closes(case, record_property):
    row, slot = np.nonzero(case.answer["found"])
    q = case.answer["q"][row, slot]
    position, rotation = misses(case.arm, q, case.poses[row])
    worst = max(position.max(initial=0), rotation.max(initial=0))
    case.say(record_property, f"{len(q)} answers, worst {worst:.1e} m or rad")
    assert np.all(np.isfinite(position + rotation))
    assert worst < CLOSES[np.float64], what_is_near(case.arm, q[np.argmax(position + rotation)])


def test_answers_are_distinct_counted_and_finite(case):
    answer = case.answer
    for slot in range(1, answer["q"].shape[1]):
        apart = judge.apart(answer["q"][:, :slot], answer["q"][:, slot, None])
        both = answer["found"][:, :slot] & answer["found"][:, slot, None]
        twice = both & (apart <= SAME)
        assert not twice.any(), listing(case, twice, answer["q"])
    np.testing.assert_array_equal(answer["count"], answer["found"].sum(axis=1))
    assert np.all(np.isfinite(answer["q"]))
    for name in ("position_error", "rotation_error"):
        assert not np.any(np.isnan(answer[name]))
        np.testing.assert_array_equal(np.isfinite(answer[name]), answer["found"])


def test_limits_and_status_tell_the_truth(case):
    answer, lower, upper = case.answer, case.arm.lower, case.arm.upper
    # A solution is within limits where whole turns can bring every joint there.
    margin = np.full(answer["q"].shape, -np.inf)
    for turn in range(-2, 3):
        turned = answer["q"] + 2 * np.pi * turn
        margin = np.maximum(margin, np.minimum(turned - lower, upper - turned))
    margin = margin.min(axis=-1)
    within, found = answer["within_limits"], answer["found"]
    assert not np.any(within & ~found)
    assert np.all(margin[within] > -1.1 * LIMIT)
    assert np.all(margin[found & ~within] < -0.9 * LIMIT)
    shown = np.minimum(answer["q"] - lower, upper - answer["q"]).min(axis=-1)
    assert np.all(shown[within] > -1.1 * LIMIT), "the turn that is within the limits is returned"
    np.testing.assert_array_equal(answer["status"] == IKStatus.SOLVED, within.any(axis=1))
    reachable = case.truth.found.any(axis=1)
    assert reachable.all(), "the judge knows that these poses can be reached"
    assert np.all(np.isin(answer["status"], [IKStatus.SOLVED, IKStatus.OUTSIDE_LIMITS]))


# Single precision.


SCALES = [pytest.param("small"), pytest.param("full", marks=pytest.mark.completeness)]


NEARLY_STRETCHED = [[-0.25339369, -0.61593226, 1.44003797, 0.81947834, 0.45196748, -0.73719575]]
"""Of the Niryo One: its solution and another all but merge where rounding moves the elbow most."""


@pytest.mark.parametrize(
    ("scale", "name"),
    [
        *(pytest.param("small", name) for name in ("niryo_one", "spherical")),
        *(pytest.param("full", name, marks=pytest.mark.completeness) for name in sets.NAMED),
    ],
)
def test_float32_finds_nearly_all_and_nothing_spurious(scale, name, record_property):
    arm = sets.robot(name)
    q = sets.in_limits(arm, 5000 if scale == "full" else 200, np.random.default_rng(11))
    q = np.concatenate([NEARLY_STRETCHED, q])
    poses = sets.poses_of(arm, q)
    rounded = poses.astype(np.float32)
    truth, answer = sets.solve(arm, poses), answers(arm, rounded)
    case = Case(f"{name} float32", "float32", scale == "full", arm, q, poses, truth, answer)
    assert answer["q"].dtype == np.float32
    assert np.all(np.isfinite(answer["q"]))
    gap = gaps(answer["q"].astype(float), answer["found"], truth.q)
    missed = truth.found & ~(gap < allowed(truth.singular, np.float32))
    recall = 1 - missed.sum() / truth.found.sum()
    # The solver is given the rounded pose, so it answers for the rigid motion nearest to that.
    row, slot = np.nonzero(answer["found"])
    u, _, vt = np.linalg.svd(rounded[:, :3, :3].astype(float))
    target = rounded.astype(float)
    target[:, :3, :3] = u @ vt
    found = answer["q"][row, slot]
    position, rotation = misses(arm, found, target[row])
    case.say(
        record_property,
        f"{missed.sum()} of {truth.found.sum()} missed ({recall:.4%}); worst {position.max():.1e} m"
        f" and {rotation.max():.1e} rad",
    )
    excess = np.maximum(position, rotation) - rounding_of(found)
    worst = np.argmax(excess)
    assert excess[worst] < CLOSES[np.float32], what_is_near(arm, found[worst].astype(float))
    assert recall >= 0.999, listing(case, missed, truth.q)
    # Rounding takes a pose at the edge of reach beyond it.
    told = answer["status"] == IKStatus.UNREACHABLE
    assert not told.any() or not sets.solve(arm, target[told]).found.any()


# Poses out of reach.


@pytest.mark.parametrize("kind", sets.UNREACHABLE)
@pytest.mark.parametrize("name", sets.NAMED)
@pytest.mark.parametrize("scale", SCALES)
def test_what_cannot_be_reached_is_never_found(scale, name, kind, record_property):
    arm = sets.robot(name)
    n = 5000 if scale == "full" else 250
    poses = sets.UNREACHABLE[kind](arm, n, np.random.default_rng(12))
    answer = answers(arm, poses)
    share = np.mean(answer["status"] == IKStatus.UNREACHABLE)
    if scale == "full":
        record_property("figure", f"{name} {kind}: {share:.4%} of {n} told unreachable")
    assert not answer["found"].any()
    assert not answer["count"].any()
    np.testing.assert_array_equal(answer["q"], 0.0)
    assert share >= 0.999
    assert np.all(np.isin(answer["status"], [IKStatus.UNREACHABLE, IKStatus.UNDECIDED]))


@pytest.mark.parametrize("name", ["niryo_one", "irb120", "all_at_once"])
@pytest.mark.parametrize("scale", SCALES)
def test_poses_anywhere_are_solved_or_refused_rightly(scale, name, record_property):
    arm = sets.robot(name)
    poses = sets.anywhere(arm, 5000 if scale == "full" else 200, np.random.default_rng(13))
    truth, answer = sets.solve(arm, poses), answers(arm, poses)
    case = Case(f"{name} anywhere", "anywhere", scale == "full", arm, None, poses, truth, answer)
    gap = gaps(answer["q"], answer["found"], truth.q)
    missed = truth.found & ~(gap < allowed(truth.singular))
    reachable = truth.found.any(axis=1)
    case.say(
        record_property,
        f"{missed.sum()} of {truth.found.sum()} missed; {reachable.mean():.1%} reach",
    )
    assert not missed.any(), listing(case, missed, truth.q)
    assert not np.any(answer["found"][~reachable])
    assert not np.any(answer["status"][reachable] == IKStatus.UNREACHABLE)
    assert np.all(np.isin(answer["status"][~reachable], [IKStatus.UNREACHABLE, IKStatus.UNDECIDED]))


# Batches.


@pytest.mark.parametrize("batch", BATCHES)
def test_an_answer_does_not_depend_on_the_shape_of_its_batch(batch):
    arm = sets.robot("niryo_one")
    poses = sets.poses_of(arm, sets.in_limits(arm, 6, np.random.default_rng(14)))
    size = int(np.prod(batch))
    flat, shaped = (
        answers(arm, poses),
        nj.inverse_kinematics(arm, poses[:size].reshape(*batch, 4, 4)),
    )
    for field in ("found", "within_limits", "status", "count"):
        part = flat[field][:size]
        np.testing.assert_array_equal(getattr(shaped, field), part.reshape(batch + part.shape[1:]))
    np.testing.assert_allclose(shaped.q, flat["q"][:size].reshape(*batch, 16, 6), atol=1e-11)


# The judge itself.


@pytest.mark.parametrize("name", ["niryo_one", "all_at_once"])
def test_the_judge_finds_no_more_with_a_finer_grid_and_more_starts(name):
    arm = sets.robot(name)
    poses = sets.poses_of(arm, sets.in_limits(arm, 50, np.random.default_rng(15)))
    coarse, fine = sets.solve(arm, poses), sets.solve(arm, poses, nodes=8192, starts=40, seed=1)
    np.testing.assert_array_equal(coarse.count, fine.count)
    assert gaps(coarse.q, coarse.found, fine.q)[fine.found].max() < judge.MERGE


def test_the_judge_and_the_extended_precision_agree_on_forward_kinematics(rng):
    arm = sets.robot("all_at_once")
    q = rng.uniform(-np.pi, np.pi, (50, 6))
    rotation, position, _ = judge.forward(judge.Geometry.of(arm.screws), np.asarray(arm.home), q)
    truth = product_of_exponentials(arm.screws, arm.home, q)
    np.testing.assert_allclose(rotation, truth[:, :3, :3].astype(float), atol=1e-14)
    np.testing.assert_allclose(position, truth[:, :3, 3].astype(float), atol=1e-14)
