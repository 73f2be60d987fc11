"""How long each public function takes to compile, and what does not compile again.

    python -m benchmarks.compiling [--poses 1024] [--save]

Seconds of the first call less those of the second, in one process on all cores, without a
persistent cache. A robot of the same structure, a batch of another size within the same padding and
a second call must not compile anything.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import niryo_jax as nj
from benchmarks.measure import Claim, Report, about, header, table

LIMIT = 2.0
"""Seconds, for every function but complete inverse kinematics..."""

COMPLETE_LIMIT = 15.0
"""... and for that."""


def functions(poses: int) -> dict[str, Callable[[], Any]]:
    """Every public function of the core on a batch, or on one where it takes one."""
    robot = nj.robots.niryo_one()
    rng = np.random.default_rng(0)
    q = jnp.asarray(rng.uniform(robot.lower, robot.upper, (poses, 6)))
    pose = nj.forward_kinematics(robot, q)
    twist, point = jnp.asarray(rng.standard_normal((poses, 6))), jnp.ones((poses, 3))
    screws, sub = jnp.asarray(robot.screws), nj.subproblems
    step = 1e-3 * jnp.arange(poses)[:, None]
    path = nj.forward_kinematics(robot, jnp.full(6, 0.3) + step * jnp.ones(6))
    distance = jnp.full(poses, 0.5)
    return {
        "forward_kinematics": lambda: nj.forward_kinematics(robot, q),
        "link_poses": lambda: nj.link_poses(robot, q),
        "space_jacobian": lambda: nj.space_jacobian(robot, q),
        "body_jacobian": lambda: nj.body_jacobian(robot, q),
        "autodiff_space_jacobian": lambda: nj.autodiff_space_jacobian(robot, q),
        "manipulability": lambda: nj.manipulability(robot, q),
        "condition_number": lambda: nj.condition_number(robot, q),
        "so3.exp": lambda: nj.so3.exp(twist[:, :3]),
        "so3.log": lambda: nj.so3.log(pose[:, :3, :3]),
        "so3.project": lambda: nj.so3.project(pose[:, :3, :3]),
        "se3.exp": lambda: nj.se3.exp(twist),
        "se3.log": lambda: nj.se3.log(pose),
        "se3.adjoint": lambda: nj.se3.adjoint(pose),
        "se3.inverse": lambda: nj.se3.inverse(pose),
        "se3.project": lambda: nj.se3.project(pose),
        "paden_kahan_1": lambda: sub.paden_kahan_1(screws[0], point, point[:, ::-1]),
        "paden_kahan_2": lambda: sub.paden_kahan_2(screws[0], screws[1], point, point[:, ::-1]),
        "paden_kahan_3": lambda: sub.paden_kahan_3(screws[0], point, point[:, ::-1], distance),
        "newton_raphson": lambda: nj.newton_raphson(robot, pose, q + 0.1),
        "inverse_kinematics": lambda: nj.inverse_kinematics(robot, pose),
        "IKSolutions.nearest": lambda: nj.inverse_kinematics(robot, pose).nearest(q),
        "follow": lambda: nj.follow(robot, path, np.full(6, 0.3)),
        "nearest_reachable": lambda: nj.nearest_reachable(robot, 2.0 * pose - jnp.eye(4)),
        "inverse_kinematics, spherical wrist": lambda: nj.inverse_kinematics(spherical(), pose),
    }


def spherical() -> nj.Robot:
    """The arm of the benchmark whose wrist axes meet."""
    from benchmarks.poses import spherical

    return spherical().robot


class Programs:
    """Counts what XLA compiles."""

    def __init__(self) -> None:
        self.count = 0
        jax.monitoring.register_event_duration_secs_listener(self._heard)

    def _heard(self, event: str, _seconds: float, **_more: Any) -> None:
        self.count += event == "/jax/core/compile/backend_compile_duration"

    def during(self, function: Callable[[], Any]) -> int:
        """How many programs a call compiles."""
        before = self.count
        jax.block_until_ready(function())
        return self.count - before


def measure(poses: int) -> Report:
    """Everything."""
    facts = about(poses=poses)
    report = Report("Compile times", {"about": facts}, [header(facts)])
    programs, lines, slow = Programs(), [], list[str]()
    for name, function in functions(poses).items():
        started = time.perf_counter()
        count = programs.during(function)
        first = time.perf_counter() - started
        started = time.perf_counter()
        again = programs.during(function)
        seconds = max(0.0, first - (time.perf_counter() - started))
        limit = COMPLETE_LIMIT if name.startswith("inverse_kinematics") else LIMIT
        if seconds > limit:
            slow.append(f"{name} {seconds:.1f} s")
        if again:
            report.wrong.append(f"{name}: a second call compiles {again} programs")
        lines.append([name, f"{seconds:.2f}", str(count)])
        report.data[name] = {"seconds": seconds, "programs": count}
        print(f"  {name}: {seconds:.2f} s", flush=True)
    report.sections.append(table(["function", "compile (s)", "programs"], lines))
    text = f"every function but complete IK compiles in {LIMIT:.0f} s, that in {COMPLETE_LIMIT:.0f}"
    detail = f": all but {', '.join(slow)}" if slow else ""
    report.claims.append(Claim(text + detail, not slow))
    report.claims += again_claims(programs, poses)
    return report


def again_claims(programs: Programs, poses: int) -> list[Claim]:
    """What must not compile again, counted."""
    one, other = nj.robots.niryo_ned(), nj.robots.niryo_ned2()
    rng = np.random.default_rng(1)
    q = rng.uniform(-0.5, 0.5, (poses, 6))

    def use(robot: nj.Robot, size: int) -> Any:
        pose = nj.forward_kinematics(robot, q[:size])
        found = nj.inverse_kinematics(robot, pose)
        return found, nj.newton_raphson(robot, pose, q[:size]), nj.space_jacobian(robot, q[:size])

    use(one, poses)
    swapped = programs.during(lambda: use(other, poses))
    nj.forward_kinematics(one, q[: poses - 3])
    nj.space_jacobian(one, q[: poses - 3])
    pose = np.asarray(nj.forward_kinematics(one, q[: poses - 3]))
    smaller = programs.during(lambda: nj.inverse_kinematics(one, pose).q)
    solver = programs.during(lambda: nj.newton_raphson(one, pose, q[: poses - 3]).q)
    return [
        Claim(f"a robot of the same structure compiles nothing: {swapped} programs", swapped == 0),
        Claim(
            f"a batch smaller by 3 compiles no solver again, only its padding and cutting: "
            f"{smaller} small programs for complete IK, {solver} for Newton-Raphson",
            smaller <= 6 and solver <= 6,
        ),
    ]


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=1024)
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/")
    options = parser.parse_args()
    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_compilation_cache_dir", None)
    return measure(options.poses).finish("compiling" if options.save else None)


if __name__ == "__main__":
    raise SystemExit(main())
