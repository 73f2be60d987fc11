"""All cases, and the public functions that have no derivative by nature, with the reason."""
from derivative_cases_lie import GROUPS, SUBPROBLEMS
CASES = [*GROUPS, *SUBPROBLEMS]
WITHOUT = {}
def contract(): return ""
