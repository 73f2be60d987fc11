"""Newton-Raphson, the errors that it drives to zero, and derivatives of what it finds."""
