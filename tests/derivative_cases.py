"""All cases, and the public functions that have no derivative by nature, with the reason."""

from __future__ import annotations

from derivative_cases_arms import CHAINS
from derivative_cases_ik import SOLVERS
from derivative_cases_lie import GROUPS, SUBPROBLEMS
from derivative_cases_uncertainty import UNCERTAINTY
from derivative_cases_uses import COLLISION, MOTION

CASES = [*GROUPS, *SUBPROBLEMS, *CHAINS, *SOLVERS, *MOTION, *COLLISION, *UNCERTAINTY]

_REASONS = {
    "words, names, numbers of things, yes or no": """
        IKSolutions.message Robot.describe Robot.joints Robot.is_general collision.collides
        Robot.offset_wrist Robot.plans Robot.ends Robot.spare ik.method_for
        calibration.Calibration.message calibration.Calibration.doubted
        calibration.Calibration.told calibration.Calibration.turned
        collision.CollisionModel.allow collision.CollisionModel.pair_names
        collision.World.counts collision.Distances.nearest collision.Distances.nearest_pair
        robots.names uncertainty.Comparison.agrees uncertainty.Sensitivity.ranking
        subproblems.SubproblemKind.message motion.MotionLimits.joints motion.VelocityResult.ok
        collision.Free.all_collide collision.Free.message collision.Free.within
        collision.CollisionCheck.check_arm collision.CollisionCheck.keeps""",
    "arms, shapes and obstacles as they are": """
        robots.abb_irb120 robots.abb_irb1600 robots.abb_irb6620lx robots.abb_irb910sc
        robots.kuka_iiwa14 robots.niryo_ned robots.niryo_ned2 robots.niryo_one
        robots.niryo_one_report robots.rttr robots.ur16e robots.load robots.NiryoModel.robot
        collision.niryo_ned collision.niryo_ned2 collision.niryo_one collision.World.table
        collision.shipped motion.niryo_limits""",
    "reads or writes files": """
        robots.from_mjcf robots.from_urdf robots.to_urdf collision.from_urdf
        calibration.read_measurements workspace.from_npz workspace.to_npz workspace.to_ply
        workspace.open_map workspace.resume collision.CollisionCheck.from_text
        collision.CollisionCheck.text""",
    "looks at known numbers; `newton_raphson` follows what it returns": """
        follow nearest_reachable motion.best_path SolutionCurves.nearest
        SolutionCurves.farthest_from_limits SolutionCurves.most_manipulable""",
    "structure and bounds of a known arm": """
        Robot.known_screws collision.skeleton collision.prune workspace.extent""",
    "does what the function that it is given does": "IKSolutions.map SolutionCurves.map",
    "does what a function of another name does": """
        collision.CollisionCheck.clearance collision.CollisionCheck.distances
        collision.CollisionCheck.free collision.Free.nearest collision.Free.clearest
        motion.MotionLimits.scaled""",
    "of nodes that are held, to what their distance leaves: tests/test_motion_time.py": """
        motion.retime motion.TimedPath.at motion.TimedPath.duration""",
    "as many samples as a known duration asks for; `at` has derivatives": """
        motion.PointToPoint.every motion.TimedPath.every""",
    "keeps a function": "IKSolutions.remember",
    "fits a known arm; its steps have derivatives inside": """
        calibration.fit calibration.informative calibration.Calibration.deviations""",
    "of many poses at once, in chunks; of one: `inverse_kinematics` and `manipulability`": """
        workspace.pose_measures workspace.capability_map workspace.base_placement
        workspace.forward_map""",
    "of maps, which are finished": """
        workspace.compare workspace.reachable_volume workspace.section workspace.robot_of
        workspace.estimate workspace.collisions_of""",
    "grids, samples and rotations that are laid out": """
        workspace.MapSpec.attributes workspace.MapSpec.chunk_count workspace.MapSpec.chunk_edge
        workspace.MapSpec.chunks workspace.MapSpec.from_attributes workspace.MapSpec.of
        workspace.MapSpec.poses workspace.MapSpec.rotations workspace.MapSpec.share
        workspace.MapSpec.sizes workspace.MapSpec.variables workspace.Orientations.quaternions
        workspace.given workspace.joint_samples workspace.orientations""",
    "processes and their progress": "workspace.one_of_many workspace.progress_bar",
    "a simulated study, from measurement to picture": """
        studies.block_stacking studies.instrument studies.postures studies.stacking_figure
        studies.typical_wear""",
    "times, looks at and carries out a known plan": """
        studies.TimedPlan.duration studies.TimedPlan.part studies.TimedRecord.late
        studies.check_timed studies.execute_timed studies.timed_figure studies.timed_plan""",
}

WITHOUT = {name: reason for reason, names in _REASONS.items() for name in names.split()}
"""The reason why there is nothing to differentiate, by public name."""


def contract() -> str:
    """The table of docs/research.md: where there is no derivative, and what is given there."""
    lines = ["| function | by | no derivative at | given there |", "| --- | --- | --- | --- |"]
    for case in CASES:
        where = "; ".join(case.singular) or "–"
        given = "; ".join(dict.fromkeys(point.given for point in case.singular.values())) or "–"
        note = f", {case.note}" if case.note else ""
        lines.append(f"| `{case.of}`{note} | {', '.join(case.by)} | {where} | {given} |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(contract())
