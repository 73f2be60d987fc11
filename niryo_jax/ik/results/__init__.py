"""From candidates to `IKSolutions`: limits, duplicates, order, status."""
