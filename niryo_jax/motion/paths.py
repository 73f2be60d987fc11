"""Point-to-point trajectories of joint vectors and of poses (Lynch & Park, section 9.2.1)."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax._jax import is_concrete
from niryo_jax.arguments import check_choice
from niryo_jax.chain import compose
from niryo_jax.ik.newton.pose_error import Frame
from niryo_jax.ik.target import Target, make_target
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lanes.batching import as_floating, broadcast_batch, check_shape, on_lanes
from niryo_jax.lie import se3, so3
from niryo_jax.motion.time_scaling import Scaling, TimeScaling, sampled
from niryo_jax.tolerances import POSE_ROTATION


class JointTrajectory(NamedTuple):
    """Joint vectors and their rates at k times.

    Attributes:
        time: (k,) seconds, from 0 to the duration; (..., k) for durations (...).
        q: (..., k, n) radians (metres for prismatic joints).
        velocity, acceleration: (..., k, n) per second and per second squared.
    """

    time: jax.Array
    q: jax.Array
    velocity: jax.Array
    acceleration: jax.Array


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class PoseTrajectory:
    """Poses and their rates at k times.

    Attributes:
        time: (k,) seconds, from 0 to the duration; (..., k) for durations (...).
        pose: (..., k, 4, 4) in the space frame, metres.
        twist: (..., k, 6) rows (omega, v), rad/s and m/s.
        twist_rate: (..., k, 6) the derivative of the twist with respect to time.
        frame: the frame of the twist, "body" or "space"; static.
    """

    time: jax.Array
    pose: jax.Array
    twist: jax.Array
    twist_rate: jax.Array
    frame: Frame = dataclasses.field(metadata={"static": True})


def joint_trajectory(
    q_start: ArrayLike,
    q_end: ArrayLike,
    duration: ArrayLike,
    samples: int,
    scaling: Scaling = "quintic",
) -> JointTrajectory:
    """The straight line between two joint vectors, q = (1 - s) q_start + s q_end.

    Args:
        q_start, q_end: (..., n) radians (metres for prismatic joints); batch axes broadcast. No
            whole turns are added or taken away.
        duration: seconds, positive; a number, or (...) one for each trajectory.
        samples: k, 2 or more, and no more than memory has room for; equally spaced in time.
        scaling: how s depends on time: "cubic" or "quintic" (`motion.quintic_time_scaling`); a
            function from the share of the duration in [0, 1] to that of the path, of one number and
            written in jax.numpy, whose derivatives are found by autodiff; or an array (k,) or
            (..., k) of s in [0, 1], whose derivatives are those of the parabola through each sample
            and its two neighbours.

    Returns:
        A `JointTrajectory` (Lynch & Park, sections 9.2.1 and 9.2.2).

    Raises:
        ValueError: wrong shapes, a duration that is not positive and finite, fewer than two
            samples, an unknown scaling, one that leaves [0, 1] or whose samples are not k.
        TypeError: a number of samples that is no integer.
    """
    start, end = as_floating("q_start", q_start), as_floating("q_end", q_end)
    check_shape("q_start", start, (-1,))
    if end.shape[-1:] != start.shape[-1:]:
        raise ValueError(
            "q_start, q_end: expected as many joints in both, got shapes "
            f"{start.shape} and {end.shape}"
        )
    dtype = jnp.result_type(start, end)
    batch = broadcast_batch(("q_start", start, 1), ("q_end", end, 1))
    numbers = 3 * math.prod(batch) * start.shape[-1]
    time, law = sampled(scaling, duration, samples, dtype, numbers)
    return JointTrajectory(time, *_straight(start.astype(dtype), end.astype(dtype), law))


@jax.jit
def _straight(
    start: jax.Array, end: jax.Array, law: TimeScaling
) -> tuple[jax.Array, jax.Array, jax.Array]:
    s, rate, acceleration = (part[..., None] for part in law)
    start, end = start[..., None, :], end[..., None, :]
    way = end - start
    return (1.0 - s) * start + s * end, rate * way, acceleration * way


def screw_trajectory(
    start: ArrayLike,
    end: ArrayLike,
    duration: ArrayLike,
    samples: int,
    scaling: Scaling = "quintic",
    *,
    frame: Frame = "body",
) -> PoseTrajectory:
    """The motion along one constant screw, X = X_start exp(log(X_start^-1 X_end) s).

    Args:
        start, end: (..., 4, 4) poses in the space frame, metres; batch axes broadcast. Poses that
            are slightly off SE(3), as printed ones are, are projected to it.
        duration, samples, scaling: as in `joint_trajectory`.
        frame: the frame of the twist, "body" (the moving one) or "space".

    Returns:
        A `PoseTrajectory` (Lynch & Park, section 9.2.1). The rotation is the shorter one; where it
        is a half turn, one of the two. Traced poses that are no rigid motions give NaN.

    Raises:
        ValueError: as `joint_trajectory`; an unknown frame; a pose that is no rigid motion.
        TypeError: a number of samples that is no integer.
    """
    return _trajectory(_SCREW, start, end, duration, samples, scaling, frame)


def cartesian_trajectory(
    start: ArrayLike,
    end: ArrayLike,
    duration: ArrayLike,
    samples: int,
    scaling: Scaling = "quintic",
    *,
    frame: Frame = "body",
) -> PoseTrajectory:
    """The origin on a straight line while the rotation follows its geodesic, each on its own.

    p = (1 - s) p_start + s p_end and R = R_start exp(log(R_start^T R_end) s). Arguments, result and
    errors as `screw_trajectory` (Lynch & Park, section 9.2.1).
    """
    return _trajectory(_DECOUPLED, start, end, duration, samples, scaling, frame)


_NUMBERS = 28
"""Of a pose, its twist and the rate of that."""

_Rates = tuple[jax.Array, jax.Array, jax.Array]


class _Path(NamedTuple):
    """A kind of path between poses.

    Attributes:
        way: from the poses of both ends to (..., 6), the whole way from one to the other.
        at: from the frame of the twist, the first pose, the way and the scaling to pose, twist and
            twist rate at every sample.
    """

    way: Callable[[jax.Array, jax.Array], jax.Array]
    at: Callable[[Frame, jax.Array, jax.Array, TimeScaling], _Rates]


def _trajectory(
    path: _Path,
    start: ArrayLike,
    end: ArrayLike,
    duration: ArrayLike,
    samples: int,
    scaling: Scaling,
    frame: Frame,
) -> PoseTrajectory:
    check_choice("frame", frame, ("body", "space"))
    first, last = _target("start", start), _target("end", end)
    batch = broadcast_batch(("start", first.pose, 2), ("end", last.pose, 2))
    dtype = jnp.result_type(first.pose, last.pose)
    time, law = sampled(scaling, duration, samples, dtype, _NUMBERS * math.prod(batch))
    # Two programs, so that another number of samples compiles the second alone.
    way = _kept(path.way(first.pose, last.pose))
    valid = first.valid & last.valid
    pose, twist, twist_rate = _along(path, frame, first.pose, way, valid, law)
    return PoseTrajectory(time, pose, twist, twist_rate, frame)


def _target(name: str, pose: ArrayLike) -> Target:
    pose = as_floating(name, pose)
    check_shape(name, pose, (4, 4))
    target = make_target(pose)
    if is_concrete(pose) and not np.all(target.valid):
        raise ValueError(
            f"{name}: expected rigid motions to within {POSE_ROTATION:g} (Frobenius norm), "
            f"got a distance of {np.max(target.distance):.3g}"
        )
    return target._replace(pose=_kept(target.pose))


@functools.partial(jax.jit, static_argnums=(0, 1))
def _along(
    path: _Path,
    frame: Frame,
    start: jax.Array,
    way: jax.Array,
    valid: jax.Array,
    law: TimeScaling,
) -> _Rates:
    """Pose, twist and twist rate at every sample; NaN where an end is no rigid motion."""
    start, way = start[..., None, :, :], way[..., None, :]
    pose, twist, twist_rate = (_kept(part) for part in path.at(frame, start, way, law))
    rows = valid[..., None, None]
    return (
        jnp.where(rows[..., None], pose, jnp.nan),
        jnp.where(rows, twist, jnp.nan),
        jnp.where(rows, twist_rate, jnp.nan),
    )


def _kept(array: jax.Array) -> jax.Array:
    """The same array, computed once, where XLA would compute it for each number made of it."""
    return lanes.materialise(Lane(array)).array


@jax.jit
def _screw_way(start: jax.Array, end: jax.Array) -> jax.Array:
    """The screw from start to end in the frame of the start."""

    def relative(start: Lanes, end: Lanes) -> Lanes:
        return se3.assemble(*compose(se3.inverse_lanes(*se3.split(start)), se3.split(end)))

    return se3.log(_kept(on_lanes(relative, ("start", start, (4, 4)), ("end", end, (4, 4)))))


def _screw_at(frame: Frame, start: jax.Array, way: jax.Array, law: TimeScaling) -> _Rates:
    def parts(start: Lanes, moved: Lanes, way: Lanes, rates: Lanes) -> tuple[Lanes, ...]:
        rotation, position = se3.split(start)
        pose = se3.assemble(*compose((rotation, position), se3.split(moved)))
        if frame == "space":
            w, v = rotation @ way[:3], rotation @ way[3:]
            way = np.concatenate([w, v + lanes.cross(position, w)])
        return pose, way * rates[0], way * rates[1]

    return on_lanes(
        parts,
        ("start", start, (4, 4)),
        ("moved", _kept(se3.exp(way * law.s[..., None])), (4, 4)),
        ("way", way, (6,)),
        ("rates", jnp.stack(law[1:], axis=-1), (2,)),
    )


@jax.jit
def _decoupled_way(start: jax.Array, end: jax.Array) -> jax.Array:
    """The rotation vector from start to end in the frame of the start, and the displacement."""

    def relative(start: Lanes, end: Lanes) -> Lanes:
        (r_start, p_start), (r_end, p_end) = se3.split(start), se3.split(end)
        return se3.assemble(r_start.T @ r_end, p_end - p_start)

    def way(relative: Lanes) -> Lanes:
        rotation, line = se3.split(relative)
        return np.concatenate([so3.log_lanes(rotation), line])

    between = on_lanes(relative, ("start", start, (4, 4)), ("end", end, (4, 4)))
    return on_lanes(way, ("relative", _kept(between), (4, 4)))


def _decoupled_at(frame: Frame, start: jax.Array, way: jax.Array, law: TimeScaling) -> _Rates:
    def parts(start: Lanes, turned: Lanes, way: Lanes, law: Lanes) -> tuple[Lanes, ...]:
        s, rate, acceleration = law
        turn, line = way[:3], way[3:]
        first, position = se3.split(start)
        rotation, position = lanes.materialised(first @ turned), position + line * s
        # The linear part of a twist is the velocity of the body's point at the frame's origin.
        if frame == "body":
            line = lanes.materialised(rotation.T @ line)
            v, v_rate = line * rate, line * acceleration
            v_rate = v_rate - lanes.cross(turn * rate, v)
        else:
            turn = first @ turn
            v = line * rate - lanes.cross(turn * rate, position)
            v_rate = (line - lanes.cross(turn, position)) * acceleration
            v_rate = v_rate - lanes.cross(turn * rate, line * rate)
        twist = np.concatenate([turn * rate, v])
        twist_rate = np.concatenate([turn * acceleration, v_rate])
        return se3.assemble(rotation, position), twist, twist_rate

    return on_lanes(
        parts,
        ("start", start, (4, 4)),
        ("turned", _kept(so3.exp(way[..., :3] * law.s[..., None])), (3, 3)),
        ("way", way, (6,)),
        ("law", jnp.stack(law, axis=-1), (3,)),
    )


_SCREW = _Path(_screw_way, _screw_at)
_DECOUPLED = _Path(_decoupled_way, _decoupled_at)
