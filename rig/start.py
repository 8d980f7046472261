"""Entry point of the `rattle` command.

Imports nothing by itself: every process that the run spawns imports this module again, and should not pay for
the whole application.
"""

from __future__ import annotations

import os


def main() -> None:
    """Run the command line."""
    # gRPC would tell the terminal of every connection that ends; whatever runs here inherits this.
    os.environ.setdefault("GRPC_VERBOSITY", "ERROR")
    # Threads of OpenBLAS spin while they wait for the next product: beside the acquisition, a core's worth.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from rig.commands.cli import main as rattle

    rattle()


if __name__ == "__main__":
    main()
