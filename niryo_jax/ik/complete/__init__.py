"""Every solution of an arm, or a proof that there is none."""
