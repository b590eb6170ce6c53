"""Calls on an existing cluster of dask.distributed; its client is an executor of `concurrent.futures`, too.

A worker of dask makes each call in a process beside itself (`Crew`), as the local engine does: time and memory limits,
and one thread of linear algebra, hold there as well.  Nothing is read from or written to disk on the cluster.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from typing import Any

from occ.errors import InputError
from occ.experiment.case import code_fingerprint
from occ.experiment.child import CallLimits, Crew, Function, Lost, Tell

CONNECT = 10.0
"""[s] to reach the scheduler, and to wait for its first worker."""
AHEAD = 2
"""Calls that are sent for each thread of the cluster, so that none waits for its next one."""


@cache
def _crew(limits: CallLimits) -> Crew:
    """The processes beside a worker of dask, kept until it ends: they end with it."""
    return Crew(limits)


def _call(function: Function, limits: CallLimits, item: Any) -> Any:
    return _crew(limits).call(function, item)


def _dismiss(limits: CallLimits) -> None:
    _crew(limits).stop()
    _crew.cache_clear()


@contextmanager
def cluster_calls(address: str, limits: CallLimits) -> Iterator[ClusterCalls]:
    """Calls on the cluster behind a scheduler.

    Args:
        address: of the scheduler.
        limits: of each call.

    Yields:
        Where calls are submitted; what is still running at the end is cancelled, and its processes are ended.

    Raises:
        InputError: dask.distributed is not installed, no scheduler there, no workers, or another version of the code.
    """
    try:
        from distributed import Client
        from distributed.comm import get_address_host_port, parse_address, unparse_address
    except ImportError as error:
        raise InputError("--dask: dask.distributed is not installed; occ[cluster] should be installed") from error
    try:
        # A client of an address that is none says so a second time, with a traceback, when it is thrown away.
        get_address_host_port(unparse_address(*parse_address(address)), strict=True)
        client = Client(address, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(
            f"--dask {address}: no scheduler answers there; should be the address that dask-scheduler prints"
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=CONNECT)
        except TimeoutError as error:
            raise InputError(f"--dask {address}: the scheduler has no workers; should have one at least") from error
        _same_code(client, address)
        executor = client.get_executor(pure=False)
        try:
            yield ClusterCalls(client, executor, limits)
        finally:
            executor.shutdown(wait=False)
            # A worker that is just going away cannot be asked; its processes end with it.
            with suppress(Exception):
                client.run(_dismiss, limits, on_error="ignore")


def _same_code(client: Any, address: str) -> None:
    """Refuse workers whose results would be stored under the wrong version of the code."""
    found = client.run(code_fingerprint, on_error="return")
    other = [worker for worker, value in found.items() if value != code_fingerprint()]
    if other:
        raise InputError(
            f"--dask {address}: another version of occ or of its libraries runs on {', '.join(sorted(other))}; "
            "should be the one that runs here"
        )


@dataclass(frozen=True)
class ClusterCalls:
    """Calls on a cluster, as `occ.experiment.pool` makes them.

    Args:
        client: of dask.distributed.
        executor: of the client.
        limits: of each call.
    """

    client: Any
    executor: Any
    limits: CallLimits

    def submit(self, function: Function, item: Any, heard: Tell) -> Future[Any]:
        """Send a call to whichever worker is free; what it tells on its way is kept there, and comes if it is lost."""
        future: Future[Any] = self.executor.submit(_call, function, self.limits, item)
        return future

    def capacity(self) -> int:
        """Calls that may be on their way; workers may come and go."""
        return max(1, AHEAD * sum(self.client.nthreads().values()))

    def outcome(self, future: Future[Any]) -> Any:
        """The answer of a call, or `Lost` where the cluster has given it up.

        Raises:
            InputError: the scheduler is gone.
        """
        from concurrent.futures import CancelledError

        from distributed import KilledWorker

        try:
            return future.result()
        except KilledWorker as error:
            return Lost(f"the workers of the cluster that took it ended: {' '.join(str(error).split())}")
        except CancelledError as error:
            raise InputError(
                "--dask: the scheduler is gone; what is finished is stored, another run goes on from there"
            ) from error
