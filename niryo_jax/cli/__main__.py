"""`python -m niryo_jax.cli`."""

from niryo_jax.cli import main

main()
