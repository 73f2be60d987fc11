"""One module for each method of `inverse_kinematics`."""
