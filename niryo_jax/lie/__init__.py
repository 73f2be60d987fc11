"""SO(3) and SE(3): exponential and logarithm, hat and vee, adjoints, projection."""
