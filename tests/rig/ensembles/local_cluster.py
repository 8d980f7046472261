"""A Dask cluster of two worker processes on loopback, in a process of its own, until its input ends.

Prints its address. Beside the test and not in it, since Dask keeps threads for as long as its process lives.
"""

from __future__ import annotations

import logging
import sys

from distributed import LocalCluster


def main() -> None:
    with LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address=None,
        worker_dashboard_address=None,
        silence_logs=logging.CRITICAL,
    ) as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main()
