"""``python -m dynhair``: the same as the ``dynhair`` command."""

from dynhair.cli import main

main()
