"""What stands behind `SimulatedNiryo`: the arm, the commands of the robot's server, and the server.

`arm` holds the state; `planning` finds joints for poses; `interpreter` checks a request and gives
its answer, with the commands of `motion`, `tools` and `storage`, the parameters of `positions` and
the words of `answers`; `server` speaks to clients.
"""
