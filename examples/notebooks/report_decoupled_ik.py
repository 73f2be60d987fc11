# %% [markdown]
# # A report: decoupled inverse kinematics, and where it is wrong
#
# A. Jnadi's report (2021) solves the Niryo One in closed form: the first three joints place the
# wrist's centre, the last three turn the tool. That needs axis 6 to pass through the centre. On
# the robot it passes at 5.5 mm. How much does this matter?

# %%
import jax
import matplotlib.pyplot as plt
import numpy as np

import niryo_jax as nj

jax.config.update("jax_enable_x64", True)
robot = nj.robots.niryo_one()
report = nj.robots.niryo_one_report()  # the report's arm, in the robot's signs

# %% [markdown]
# ## Two arms that differ by joint 6
#
# At $\theta_6=0$ both arms are one, and their tools always point the same way. With joint 6
# turned, the positions are apart by $11\sin(\theta_6/2)$ mm.

# %%
turn = np.linspace(-np.pi, np.pi, 181)
q = np.zeros((181, 6))
q[:, 5] = turn
true, modelled = (np.asarray(nj.forward_kinematics(arm, q)) for arm in (robot, report))
apart = 1e3 * np.linalg.norm((true - modelled)[:, :3, 3], axis=-1)
np.testing.assert_allclose(true[:, :3, :3], modelled[:, :3, :3], atol=1e-14)
np.testing.assert_allclose(apart, 11 * np.abs(np.sin(turn / 2)), atol=1e-10)
np.testing.assert_allclose(true[90, :3, 3], [0.2452, 0, 0.4175], atol=1e-12)

figure, axes = plt.subplots(figsize=(6, 2.6))
axes.plot(np.rad2deg(turn), apart, color="#2166ac")
axes.set_xlabel("joint 6 (deg)")
axes.set_ylabel("apart (mm)")
plt.show()

# %% [markdown]
# ## What the closed form finds
#
# The report combines all values of its formulas to 32 candidates and keeps the eight that fit.
# Root by root, each belongs to two choices of shoulder, two of elbow and two of wrist: eight, and
# none to be thrown away. They are exact for the report's arm, and miss on the robot.

# %%
random = np.random.default_rng(3)
target = nj.forward_kinematics(robot, random.uniform(robot.lower, robot.upper, (200, 6)))
decoupled, exact = (nj.inverse_kinematics(arm, target) for arm in (report, robot))
assert set(np.unique(decoupled.count)) <= {0, 4, 8}
assert decoupled.complete.all()

reached = nj.forward_kinematics(robot, decoupled.q)
miss = 1e3 * np.linalg.norm((reached - target[:, None])[..., :3, 3], axis=-1)
miss = miss[np.asarray(decoupled.found)]
print(f"the report's solutions, on the robot: off by {np.median(miss):.1f} mm in the median")
lost = int((decoupled.count == 0).sum())
print(f"poses that the robot reaches and the report's arm does not: {lost} of 200")
values, times = np.unique(exact.count, return_counts=True)
print("solutions of the robot:", ", ".join(f"{v} ({t} poses)" for v, t in zip(values, times)))
assert miss.max() <= 11 + 1e-6
assert exact.complete.all()

figure, axes = plt.subplots(figsize=(6, 2.6))
axes.hist(miss, 33, color="#2166ac")
axes.set_xlabel("miss of the decoupled solutions on the robot (mm)")
axes.set_ylabel("solutions")
plt.show()

# %% [markdown]
# ## The wrist where it is singular
#
# With $R=R_x(\theta_4)R_y(\theta_5)R_x(\theta_6)$ and $\theta_5=0$ only the sum of joints 4 and 6
# matters, and $\theta_4+\theta_6=\mathrm{atan2}(-r_{23},r_{33})$; at $\theta_5=\pi$ it is the
# difference, $\theta_6-\theta_4=\mathrm{atan2}(-r_{23},-r_{33})$. The report prints one formula
# for both, without the minus.

# %%
x, y = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])


def wrist(t4, t5, t6):
    return np.asarray(nj.so3.exp(x * t4) @ nj.so3.exp(y * t5) @ nj.so3.exp(x * t6))


straight, folded = wrist(0.3, 0.0, 0.4), wrist(0.3, np.pi, 0.4)
printed = np.arctan2(straight[1, 2], straight[2, 2])
print(f"sum 0.7: printed {printed:.2f}, right {np.arctan2(-straight[1, 2], straight[2, 2]):.2f}")
print(f"difference 0.1: right {np.arctan2(-folded[1, 2], -folded[2, 2]):.2f}")
assert np.isclose(np.arctan2(-straight[1, 2], straight[2, 2]), 0.7)
assert np.isclose(printed, -0.7)
assert np.isclose(np.arctan2(-folded[1, 2], -folded[2, 2]), 0.1)

# %% [markdown]
# At such a pose infinitely many solutions exist for the report's arm; one is returned, and marked.

# %%
singular = nj.inverse_kinematics(
    report, nj.forward_kinematics(report, [0.2, -0.3, -0.4, 0.3, 0.0, 0.4])
)
marks = {nj.Singularity(int(s)).name for s in singular.singularity[singular.found]}
print(singular.message())
print(marks)
assert "WRIST" in marks

# %% [markdown]
# ## The elbow where it is singular
#
# The report says that a degree of freedom is lost at $\theta_3=0$. It is not: the forearm is bent
# there, by the 30 mm between axes 3 and 4. The arm is stretched at $\theta_3=82.29°$,
# inside the limits, and folded at $-97.71°$.

# %%
angle = np.linspace(-180, 180, 721)
q = np.zeros((721, 6))
q[:, 1:3] = 0.2, 0.0
q[:, 2], q[:, 4] = np.deg2rad(angle), 0.6
least = np.asarray(nj.singular_values(robot, q)).min(axis=-1)
elbow = np.zeros((2, 6))
elbow[:, 2], elbow[:, 4] = np.deg2rad([82.287, -97.713]), 0.6
assert np.asarray(nj.singular_values(robot, elbow)).min(axis=-1).max() < 1e-5 < least[360]

figure, axes = plt.subplots(figsize=(6, 2.6))
axes.plot(angle, least, color="#2166ac")
axes.axvspan(
    *np.rad2deg([robot.lower[2], robot.upper[2]]), color="#eeeeee", label="within the limits"
)
axes.axvline(0, color="#b2182b", ls=":", label="the report's place")
axes.set_xlabel("joint 3 (deg)")
axes.set_ylabel("least singular value")
axes.legend(frameon=False)
plt.show()
