"""What is assumed of an arm: how its axes lie, the families it may belong to, and which it does."""
