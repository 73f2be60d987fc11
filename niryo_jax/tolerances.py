"""Every tolerance of the package, in one place, named by its reason."""

SCREW_NORM = 1e-9
"""How far a screw axis given as data may be from unit length."""

PITCH = 1e-12
"""A screw axis whose |omega . v| (metres per radian) is below this is a pure rotation."""

MOTION = 1e-6
"""How far R R^T of a home or tool pose given as data may be from the identity, per entry."""
