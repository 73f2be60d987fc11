"""What became of a pose, and of its solutions, as codes that have sentences."""

from __future__ import annotations

from niryo_jax.codes import Code


class IKStatus(Code):
    """What became of one pose."""

    SOLVED = 0, "At least one solution lies within the joint limits."
    OUTSIDE_LIMITS = 1, "The pose can be reached, but only outside the joint limits."
    UNREACHABLE = 2, "The pose cannot be reached, whatever the joint angles."
    UNDECIDED = 3, "No solution was found, and it is not proved that there is none."
    INVALID_POSE = (
        4,
        "The pose is not a rigid motion: an entry is not finite, the last row is not (0, 0, 0, 1), "
        "or the rotation block is too far from a rotation; or the value of a locked joint is not "
        "finite.",
    )


class UnreachableReason(Code):
    """What proves that a pose is out of reach."""

    NONE = 0, "Nothing proves that the pose is out of reach."
    TOO_FAR = (
        1,
        "Wherever the wrist may be for this pose, it is farther from the shoulder than the "
        "stretched arm is long.",
    )
    TOO_NEAR = (
        2,
        "Wherever the wrist may be for this pose, it is nearer to the shoulder than the folded arm "
        "can bring it.",
    )
    NO_ROOT = (
        3,
        "The wrist can be placed, but axes 4 and 5 can then never supply the rest of the rotation: "
        "the condition for it has no root, by a bound on how fast it varies.",
    )
    NO_SOLUTION = (
        4,
        "The equations of the closed form have no real solution: the pose is too far away, or none "
        "that an arm of fewer than six joints or with a locked joint can take.",
    )


class Singularity(Code):
    """Why a solution's derivatives are not those of an isolated solution."""

    NONE = 0, "The solution is regular."
    SHOULDER = (
        1,
        "The wrist point lies on axis 1, which can turn without moving it: one of infinitely many "
        "solutions.",
    )
    ELBOW = 2, "The arm is stretched or folded: two solutions are one here."
    WRIST = (
        3,
        "Two axes are aligned (4 and 6 of six with a spherical wrist) and can turn against each "
        "other: one of infinitely many solutions.",
    )
    MERGED = 4, "Two solutions are one here, or nearly: the Jacobian is singular."
    SELF_MOTION = 5, "The arm can move while the tool rests: one of infinitely many solutions."
    UNKNOWN = 6, "Whether the solution is singular was not looked at."
