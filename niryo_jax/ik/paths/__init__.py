"""Inverse kinematics along paths: one branch followed, the nearest pose that can be reached."""
