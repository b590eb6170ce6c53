"""One function over many items: in this process, in local processes, or on a cluster of dask's; one way of working.

An engine submits calls to an executor and yields outcomes as they come.  Processes and clusters make each call in a
process of its own (`occ.experiment.child`), here or on the cluster's machines, so that a call that crashes, hangs or
fills the memory is lost alone.  All engines compute with one thread of linear algebra: the order of its sums, and with
it the last bit, is the same everywhere.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from occ.checks import Positive, check_fields
from occ.errors import InputError, OccError
from occ.experiment.child import CallLimits, Crew, Lost, raised

Item = TypeVar("Item")
Part = TypeVar("Part")
Outcome = TypeVar("Outcome")
GIGABYTE = 10**9


@dataclass(frozen=True, kw_only=True)
class Engine:
    """Where work is done.

    Args:
        workers: local processes; 1 without limits is this process.
        dask: address of a scheduler, such as ``tcp://host:8786``; None is no cluster.
        time_limit: [s] of one item; an item that takes longer is lost.
        memory_limit: [GB] of address space for one process; an item that wants more is lost.

    Raises:
        InputError: workers and a cluster, or numbers that are not positive.
    """

    workers: int = 1
    dask: str | None = None
    time_limit: Positive | None = None
    memory_limit: Positive | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        if self.workers < 1:
            raise InputError(f"workers should be at least 1, not {self.workers}")
        if self.dask is not None and self.workers != 1:
            raise InputError("workers are local processes and dask is a cluster; should be one of the two")

    @property
    def here(self) -> bool:
        """Whether the work is done in this process, where nothing can be ended from outside."""
        return self.dask is None and self.workers == 1 and self.limits == CallLimits()

    @property
    def limits(self) -> CallLimits:
        """Of one call."""
        memory = None if self.memory_limit is None else int(self.memory_limit * GIGABYTE)
        return CallLimits(time=self.time_limit, memory=memory)

    def each(
        self, function: Callable[[Item], Outcome], items: Iterable[Item]
    ) -> Generator[tuple[int, Outcome | Lost], None, None]:
        """function(item) of each item.

        Args:
            function: that a new process can import.
            items: plain data; taken one by one as there is room, so that millions may come from a generator.

        Yields:
            Number of the item and its outcome, in the order in which they finish.

        Raises:
            InputError: no such cluster, or one that runs another version of the code.
            OccError: that the function has raised; an item that raises anything else is lost.
        """
        if self.here:
            return _here(function, items)
        return _submitted(self._calls(), function, items)

    def each_or_parts(
        self, function: Callable[[Item | Part], Outcome], items: Iterable[Item], parts: Callable[[int], Sequence[Part]]
    ) -> Generator[tuple[int, Outcome | Lost | list[Outcome | Lost]], None, None]:
        """function(item) of each item, and of the parts of those that are lost: what goes wrong is lost alone.

        Args:
            function: as in `each`; of parts as well.
            items: as in `each`.
            parts: of the item of that number; empty where it has none.

        Yields:
            Number of the item and its outcome, or the outcomes of its parts in their order.

        Raises:
            InputError: as in `each`.
            OccError: as in `each`.
        """
        places: list[tuple[int, int]] = []
        again: list[Part] = []
        divided: dict[int, list[Outcome | Lost]] = {}
        with closing(self.each(function, items)) as finished:
            for number, outcome in finished:
                pieces = parts(number) if isinstance(outcome, Lost) else ()
                if not pieces:
                    yield number, outcome
                    continue
                assert isinstance(outcome, Lost)
                divided[number] = [outcome] * len(pieces)
                places += [(number, place) for place in range(len(pieces))]
                again += pieces
        left = Counter(number for number, _ in places)
        with closing(self.each(function, again)) as finished:
            for position, outcome in finished:
                number, place = places[position]
                divided[number][place] = outcome
                left[number] -= 1
                if not left[number]:
                    yield number, divided.pop(number)

    @contextmanager
    def _calls(self) -> Iterator[_Calls]:
        if self.dask is not None:
            from occ.experiment.cluster import cluster_calls

            with cluster_calls(self.dask, self.limits) as calls:
                yield calls
            return
        crew = Crew(self.limits)
        with ThreadPoolExecutor(self.workers) as executor:
            try:
                yield _LocalCalls(crew, executor, self.workers)
            finally:
                executor.shutdown(wait=False, cancel_futures=True)
                crew.stop()


class _Calls(Protocol):
    """An executor of `concurrent.futures` whose calls are made in processes of their own."""

    def submit(self, function: Callable[[Any], Any], item: Any) -> Future[Any]: ...

    def capacity(self) -> int: ...

    def outcome(self, future: Future[Any]) -> Any: ...


@dataclass(frozen=True)
class _LocalCalls:
    crew: Crew
    executor: ThreadPoolExecutor
    workers: int

    def submit(self, function: Callable[[Any], Any], item: Any) -> Future[Any]:
        return self.executor.submit(self.crew.call, function, item)

    def capacity(self) -> int:
        return self.workers

    def outcome(self, future: Future[Any]) -> Any:
        return future.result()


def _here(
    function: Callable[[Item], Outcome], items: Iterable[Item]
) -> Generator[tuple[int, Outcome | Lost], None, None]:
    # Each of them brings a library of linear algebra of its own, which must be there to be limited.
    import casadi  # noqa: F401 - to be there
    import scipy.linalg  # noqa: F401 - to be there
    from threadpoolctl import ThreadpoolController

    libraries = ThreadpoolController()
    for number, item in enumerate(items):
        with libraries.limit(limits=1):
            try:
                outcome: Outcome | Lost = function(item)
            except OccError:
                raise
            except Exception as error:  # whatever an item does, the others go on
                outcome = raised(error)
        yield number, outcome


def _submitted(
    opened: Any, function: Callable[[Item], Outcome], items: Iterable[Item]
) -> Generator[tuple[int, Outcome | Lost], None, None]:
    waiting = enumerate(items)
    running: dict[Future[Any], int] = {}
    with opened as calls:
        while True:
            while len(running) < calls.capacity():
                following = next(waiting, None)
                if following is None:
                    break
                running[calls.submit(function, following[1])] = following[0]
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                number = running.pop(future)
                yield number, calls.outcome(future)
