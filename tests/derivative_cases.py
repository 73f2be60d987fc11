"""All cases, and the public functions that have no derivative by nature, with the reason."""
from derivative_cases_lie import GROUPS, SUBPROBLEMS
from derivative_cases_arms import CHAINS, SOLVERS
CASES = [*GROUPS, *SUBPROBLEMS, *CHAINS, *SOLVERS]
WITHOUT = {}
def contract(): return ""
