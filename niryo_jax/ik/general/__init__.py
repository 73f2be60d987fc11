"""Six revolute joints of any geometry: one polynomial, its roots with a proof, joint vectors."""
