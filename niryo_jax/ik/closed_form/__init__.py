"""Closed forms of the families of arms."""
