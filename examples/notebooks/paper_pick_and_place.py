# %% [markdown]
# # The paper: screw theory of the Niryo One, and its pick and place
#
# V. Todorović et al. (2024) describe the Niryo One by six screws, guess its joints from
# Paden-Kahan subproblems of a simpler arm, and refine the guesses by Newton-Raphson. The
# experiment picks an object and places it, in ten steps with five different poses (Table 2.1).
# Here the same is done, and every solution of each pose is found beside it.

# %%
import itertools

import jax
import matplotlib.pyplot as plt
import numpy as np

import niryo_jax as nj
from niryo_jax.hardware.pick_and_place import TABLE_2_1
from niryo_jax.ik import BranchStatus, seeded_branches

jax.config.update("jax_enable_x64", True)
robot = nj.robots.niryo_one()
names = ["start", "above the object", "at the object", "above the place", "at the place"]
poses = np.stack([TABLE_2_1[i].pose for i in (0, 1, 2, 5, 6)])
print(robot.describe())

# %% [markdown]
# ## The printed poses
#
# The pose of the start is printed with three decimals, which is no rigid motion: solvers that test
# for one, the published one among them, find nothing there. Here poses are projected to the
# nearest rigid motion, and the distance is reported.

# %%
solutions = nj.inverse_kinematics(robot, poses)
for name, distance in zip(names, np.asarray(solutions.pose_distance)):
    print(f"{name:17s} {distance:.1e} from a rigid motion")
assert solutions.pose_distance[0] > 1e-4
assert np.all(solutions.pose_distance[1:] < 1e-9)

# %% [markdown]
# ## The published method
#
# If axis 6 passed through the point where axes 4 and 5 meet, eight joint vectors would follow from
# subproblems. On the robot it passes that point at 5.5 mm: so far each guess is off, and Newton's
# method mends that, or leads elsewhere.

# %%
branches = seeded_branches(robot, poses)
miss = 1e3 * np.asarray(branches.guess_error)
print("guesses miss by", np.unique(np.round(miss, 2)), "mm")
for name, outcome in zip(names, np.asarray(branches.outcome)):
    words = [BranchStatus(int(code)).name for code in outcome]
    print(f"{name:17s}", ", ".join(f"{words.count(w)} {w}" for w in sorted(set(words))))

# %% [markdown]
# ## All solutions
#
# The paper counts eight solutions at most, which is right of the simpler arm. The robot has up to
# sixteen: ten at the start.

# %%
published = nj.inverse_kinematics(robot, poses, method="seeded")
counts = np.asarray(solutions.count)
print("complete:", counts, "proved:", bool(solutions.complete.all()))
assert counts.tolist() == [10, 8, 8, 8, 8]
assert solutions.complete.all()
assert np.all(published.count <= counts)

figure, axes = plt.subplots(figsize=(7.5, 3))
place = np.arange(5)
axes.bar(place - 0.25, counts, 0.25, label="all", color="#2166ac")
axes.bar(place, np.asarray(published.count), 0.25, label="published method", color="#9aa0a6")
inside = np.asarray(solutions.within_limits.sum(axis=-1))
axes.bar(place + 0.25, inside, 0.25, label="within the limits", color="#b2182b")
axes.set_xticks(place, [name.replace(" the", "\nthe") for name in names])
axes.set_ylim(0, 14)
axes.set_ylabel("solutions")
axes.legend(frameon=False, ncols=3, loc="upper center")
plt.show()

# %% [markdown]
# Each pose has one solution within the limits, so there is nothing to choose. These are the joint
# angles of the experiment:

# %%
q, ok = solutions.farthest_from_limits()
assert ok.all()
for name, angles in zip(names, np.rad2deg(q)):
    print(f"{name:17s}", " ".join(f"{angle:8.2f}" for angle in angles + 0.0))
np.testing.assert_allclose(q[0], [0, 0.3, -1.3, 0, 0, 0], atol=2e-3)
np.testing.assert_allclose(np.rad2deg(q[2]), [-45, -46.866, -34.862, 0, -8.272, -45], atol=1e-3)

# %% [markdown]
# ## The way of the tool
#
# Joints move in straight lines from one step to the next; the tool does not.

# %%
order = [0, 1, 2, 1, 3, 4, 3, 0]
stops = np.asarray(q)[order]
legs = [
    nj.motion.joint_trajectory(a, b, duration=1.0, samples=40).q
    for a, b in itertools.pairwise(stops)
]
way = 1e3 * np.asarray(nj.forward_kinematics(robot, np.concatenate(legs)))[:, :3, 3]
places = 1e3 * poses[:, :3, 3]

figure, (above, side) = plt.subplots(1, 2, figsize=(8, 3.4))
for axes, (i, j), labels in ((above, (0, 1), "xy"), (side, (1, 2), "yz")):
    axes.plot(way[:, i], way[:, j], color="#2166ac", lw=1)
    axes.plot(places[:, i], places[:, j], "o", color="#b2182b", ms=4)
    axes.set_xlabel(f"{labels[0]} (mm)")
    axes.set_ylabel(f"{labels[1]} (mm)")
    axes.set_aspect("equal")
above.set_title("from above")
side.set_title("from the front")
plt.show()

# %% [markdown]
# `niryo-jax pick-and-place` carries it out on the simulated robot, or on one of your own.
#
# Misprints of the paper that matter to whoever programs it (equation 16 has its exponentials in
# the wrong order, equation 20 a sign, equation 29 lacks a square) are listed in the docstrings of
# `niryo_jax.subproblems`.
