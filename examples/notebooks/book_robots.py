# %% [markdown]
# # The book: robots and subproblems
#
# J. M. Pardos-Gotor, *Screw Theory in Robotics* (2018, 2022), solves industrial arms by sequences
# of canonical subproblems. Here are its robots with all their solutions, the pose that a numeric
# solver missed, and what subproblems return where there is none.

# %%
import jax
import matplotlib.pyplot as plt
import numpy as np

import niryo_jax as nj
from niryo_jax.robots import book

jax.config.update("jax_enable_x64", True)
names = [
    "abb_irb120",
    "abb_irb1600",
    "abb_irb6620lx",
    "abb_irb910sc",
    "ur16e",
    "kuka_iiwa14",
    "rttr",
]
arms = {name: nj.robots.load(name) for name in names}

# %% [markdown]
# ## Seven robots
#
# Twenty poses each, made from joint vectors. Of the iiwa, seven joints, joint 3 is held; otherwise
# its solutions are curves.

# %%
random = np.random.default_rng(5)
for name, arm in arms.items():
    lower, upper = (np.clip(x, -2.0, 2.0) for x in (arm.lower, arm.upper))
    q = random.uniform(lower, upper, (20, arm.joints))
    held = {"locked": (2, q[:, 2])} if arm.joints == 7 else {}
    solutions = nj.inverse_kinematics(arm, nj.forward_kinematics(arm, q), **held)
    counts = sorted({int(count) for count in solutions.count})
    worst = np.max(np.where(solutions.found, solutions.position_error, 0))
    print(f"{name:14s} {arm.joints} joints, {counts} solutions, worst miss {worst:.0e} m")
    assert solutions.complete.all()
    assert worst < 1e-12
    assert min(counts) > 0

# %% [markdown]
# ## A pose that a numeric solver missed
#
# Exercise 47 of the edition of 2018: one exact solution in microseconds, beside an answer of a
# numeric solver that is called approximate. It misses by 434 mm and 0.95 rad: it is no solution.
# There are eight.

# %%
irb120 = book.abb_irb120(up="y", edition=2018)
pose = np.array(
    [
        [-0.8401, 0.5318, 0.1069, -0.4226],
        [0.5391, 0.7968, 0.2731, 0.2161],
        [0.0600, 0.2870, -0.9560, 0.1709],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
numeric = [-1.9134, -0.1847, -0.3630, -0.1163, -1.0924, 1.4402]
solutions = nj.inverse_kinematics(irb120, pose)
miss = np.linalg.norm(nj.forward_kinematics(irb120, numeric)[:3, 3] - pose[:3, 3])
print(f"{int(solutions.count)} solutions; the numeric answer misses by {1e3 * miss:.0f} mm")
assert int(solutions.count) == 8
assert solutions.complete
assert np.isclose(miss, 0.434, atol=1e-3)

figure, axes = plt.subplots(figsize=(6, 2.8))
for angles in np.rad2deg(solutions.q[solutions.found]):
    axes.plot(range(1, 7), angles, "o-", ms=3, lw=0.8, color="#2166ac")
axes.plot(range(1, 7), np.rad2deg(numeric), "x:", color="#b2182b", label="numeric answer")
axes.set_xlabel("joint")
axes.set_ylabel("angle (deg)")
axes.legend(frameon=False)
plt.show()

# %% [markdown]
# ## Seven joints: curves of solutions
#
# The book gives sixteen solutions of the iiwa: eight for one value of joint 3, eight for one of
# joint 1. They are samples of curves, along which the elbow turns about the line from shoulder to
# wrist.

# %%
iiwa = arms["kuka_iiwa14"]
target = nj.forward_kinematics(iiwa, [0.2, 0.5, 0.3, -1.2, 0.1, 0.8, 0.0])
turn = np.linspace(-np.pi, np.pi, 200)
family = nj.inverse_kinematics(iiwa, target[None], arm_angle=turn)
print("solutions for each arm angle:", sorted({int(count) for count in family.count}))
assert family.complete.all()

figure, axes = plt.subplots(figsize=(6, 2.8))
shown = np.where(family.found, np.rad2deg(family.q[..., 2]), np.nan)
inside = np.where(family.within_limits, shown, np.nan)
axes.plot(np.rad2deg(turn), shown, ".", ms=1.5, color="#9aa0a6")
axes.plot(np.rad2deg(turn), inside, ".", ms=3, color="#2166ac")
axes.set_xlabel("arm angle (deg)")
axes.set_ylabel("joint 3 (deg); blue: within the limits")
plt.show()

# %% [markdown]
# ## Subproblems: none, one, two
#
# Paden-Kahan 3 turns a point about an axis until it is at a given distance from another. Too near
# or too far there is none; then the angle is that of the closest approach, `valid` is False and
# `residual` says by how much it misses.

# %%
sp = nj.subproblems
screw = nj.se3.screw_from_axis([0.0, 0.0, 0.0], [0.0, 0.0, 1.0])
distance = np.linspace(0.1, 3.5, 120)
one = sp.paden_kahan_3(screw, [1.0, 0.0, 0.0], [2.0, 0.0, 0.5], distance)
print("numbers of solutions:", sorted({int(n) for n in one.valid.sum(axis=-1)}))
assert {int(n) for n in one.valid.sum(axis=-1)} == {0, 2}

figure, axes = plt.subplots(figsize=(6, 2.6))
angles = np.where(one.valid, np.rad2deg(one.angles[..., 0]), np.nan)
axes.plot(distance, angles, ".", ms=3, color="#2166ac")
axes.set_xlabel("distance asked for (m)")
axes.set_ylabel("angle (deg)")
residual = axes.twinx()
residual.plot(distance, np.asarray(one.residual).min(axis=-1), color="#b2182b", lw=1)
residual.set_ylabel("residual (m)", color="#b2182b")
plt.show()
