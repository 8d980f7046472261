"""Entry point of the `rattle` command.

Imports nothing by itself: every process that the run spawns imports this module again, and should not pay for
the whole application.
"""

from __future__ import annotations


def main() -> None:
    """Run the command line."""
    from rig.app import main as rattle

    rattle()


if __name__ == "__main__":
    main()
