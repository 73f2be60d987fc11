# %% [markdown]
# # A report: errors of the joints, and what averaging hides
#
# A lab report asks how far the tool of a Niryo One is off where each joint is off by 0.01 rad. It
# draws 200 errors of each joint, averages them, and multiplies by a Jacobian: 0.4 mm. That is the
# error of an average of 200 motions, not of one.

# %%
import jax
import matplotlib.pyplot as plt
import numpy as np

import niryo_jax as nj
from niryo_jax import uncertainty as un
from niryo_jax.hardware.pick_and_place import TABLE_2_1
from niryo_jax.lie.zyz import rotation_from_zyz, zyz_from_rotation

jax.config.update("jax_enable_x64", True)
robot = nj.robots.niryo_one()
poses = np.stack([TABLE_2_1[i].pose for i in (1, 2)])  # above the object, at the object
q, ok = nj.inverse_kinematics(robot, poses).farthest_from_limits()
noise = un.Gaussian.independent(np.full(6, 0.01))
key = jax.random.key(2)

# %% [markdown]
# ## One motion, and the average of 200
#
# The spread of an average falls with the square root of the number, here by 14.

# %%
one = un.propagate(robot, q, noise.covariance(q))
average = un.propagate(robot, q, noise.covariance(q) / 200)
for i, (alone, mean) in enumerate(zip(1e3 * one.rms, 1e3 * average.rms), start=2):
    print(f"pose {i}: one motion {alone:.2f} mm rms, the average of 200 {mean:.2f} mm")
np.testing.assert_allclose(1e3 * one.rms, [3.85, 3.97], atol=0.01)

draws = noise.sample(key, q[1], 20_000)
moved = np.asarray(nj.forward_kinematics(robot, q[1] + draws))[:, :3, 3]
single = 1e3 * np.linalg.norm(moved - poses[1][:3, 3], axis=-1)
means = np.asarray(nj.forward_kinematics(robot, q[1] + draws.reshape(100, 200, 6).mean(axis=1)))
averaged = 1e3 * np.linalg.norm(means[:, :3, 3] - poses[1][:3, 3], axis=-1)

figure, axes = plt.subplots(figsize=(6, 2.6))
bins = np.linspace(0, 12, 61)
axes.hist(single, bins, density=True, color="#2166ac", label="one motion")
axes.hist(averaged, bins, density=True, color="#b2182b", label="average of 200")
axes.set_xlabel("error of the position (mm)")
axes.set_yticks([])
axes.legend(frameon=False)
plt.show()

# %% [markdown]
# The report also reads 0.01 rad as the largest error, half a degree. It is one standard deviation,
# 0.573°; three of them are 1.72°.
#
# ## The formula against a trial
#
# To first order the covariance of the pose is $J\,C\,J^T$. 200,000 draws through the exact
# kinematics agree.

# %%
tried = un.monte_carlo(robot, q, noise, key, 200_000)
print("half axes, formula (mm):", np.round(1e3 * one.ellipsoid().half_axes, 3).tolist())
print("half axes, trial   (mm):", np.round(1e3 * tried.ellipsoid().half_axes, 3).tolist())
assert np.all(un.compare(one, tried).agrees())

# %% [markdown]
# ## Which joint matters
#
# Each joint alone off by 0.01 rad. "Joint 3 matters most" is what the report concludes from three
# random tests; it is right, and the sensitivity shows it. Joint 6 turns the tool about its own
# axis and moves nothing.

# %%
un.figures.error_figure(robot, q[1], noise, key)

# %%
alone = un.sensitivity(robot, q, 0.01)
print(np.round(alone.millimetres, 2))
assert np.all(alone.ranking[:, 0] == 2)
assert np.all(alone.millimetres[:, 5] < 1e-9)

# %% [markdown]
# ## Angles ZYZ
#
# The report's ZYZ matrix has $\sin\beta\cos\beta\cos\gamma+\cos\alpha\sin\gamma$ for $r_{21}$; the
# first factor must be $\sin\alpha$. And at $\beta=\pi$ the angle is
# $\alpha=\mathrm{atan2}(-r_{21},-r_{11})$ where $\gamma=0$.

# %%
a, b, c = 0.4, 0.9, -1.3
r = rotation_from_zyz([a, b, c])
z, y = np.array([0, 0, 1.0]), np.array([0, 1.0, 0])
np.testing.assert_allclose(r, nj.so3.exp(z * a) @ nj.so3.exp(y * b) @ nj.so3.exp(z * c), atol=1e-15)
printed = np.sin(b) * np.cos(b) * np.cos(c) + np.cos(a) * np.sin(c)
print(f"r21 printed {printed:.4f}, right {r[1, 0]:.4f}")
assert np.isclose(r[1, 0], np.sin(a) * np.cos(b) * np.cos(c) + np.cos(a) * np.sin(c))
np.testing.assert_allclose(zyz_from_rotation(rotation_from_zyz([0.4, np.pi, 0.0])), [0.4, np.pi, 0])
np.testing.assert_allclose(
    np.rad2deg(zyz_from_rotation(poses[:, :3, :3])), [[0, 90, 0]] * 2, atol=1e-9
)
