# SPDX-License-Identifier: GPL-3.0-or-later
"""A Dask cluster of separate processes on this machine, for the tests: prints its address."""

from __future__ import annotations

import sys

if __name__ == "__main__":
    from distributed import LocalCluster

    cluster = LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    )
    sys.stdout.write(cluster.scheduler_address + "\n")
    sys.stdout.flush()
    sys.stdin.read()  # until the test has ended
    cluster.close()
