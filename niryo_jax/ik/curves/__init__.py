"""The solutions of an arm with one joint to spare, as curves: going along them, and their parts."""
