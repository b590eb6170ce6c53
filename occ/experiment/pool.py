"""One function over many items: in local processes, on a cluster of dask's, or in this process; one way of working.

An engine submits calls to an executor and yields outcomes as they come.  Each call is made in a process of its own
(`occ.experiment.child`), here or on the cluster's machines, so that a call that crashes, hangs or fills the memory is
lost alone; only who asks for it gets the calls made in this process.  All engines compute with one thread of linear
algebra: the order of its sums, and with it the last bit, is the same everywhere.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, fields, replace
from queue import SimpleQueue
from typing import Any, NamedTuple, Protocol, TypeVar

from occ.checks import Positive, check_fields
from occ.errors import InputError, OccError
from occ.experiment.child import CallLimits, Crew, Function, Idle, Lost, Tell, raised

Item = TypeVar("Item")
Part = TypeVar("Part")
Outcome = TypeVar("Outcome")
GIGABYTE = 10**9
PATIENCE = 3600.0
"""[s] Far more than any row takes."""

Heard = Callable[[int, int, Any], None]
"""Takes the number of an item, the place of one of its parts, and the part's outcome."""


def unheard(number: int, place: int, outcome: Any) -> None:
    """A `Heard` that does not listen."""


@dataclass(frozen=True, kw_only=True)
class Engine:
    """Where work is done.

    Args:
        workers: local processes.
        dask: address of a scheduler, such as ``tcp://host:8786``; None is no cluster.
        time_limit: [s] of one item; an item that takes longer is lost.
        memory_limit: [GB] of address space for one process; an item that wants more is lost.
        patience: [s] an item of which nothing is heard for so long, no part of it finished, is lost; None is an hour.
        in_process: whether to work in this process, as a debugger wants it, which a crash ends and a hang stops.
        idle: processes that are there already, from `kept`.

    Raises:
        InputError: workers and a cluster, this process and anything else, or numbers that are not positive.
    """

    workers: int = 1
    dask: str | None = None
    time_limit: Positive | None = None
    memory_limit: Positive | None = None
    patience: Positive | None = None
    in_process: bool = False
    idle: Idle | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_fields(self)
        if self.workers < 1:
            raise InputError(f"workers should be at least 1, not {self.workers}")
        if self.dask is not None and self.workers != 1:
            raise InputError("workers are local processes and dask is a cluster; should be one of the two")
        other = [item.name for item in fields(self) if getattr(self, item.name) != item.default]
        if self.in_process and other != ["in_process"]:
            raise InputError(f"Engine: in_process should be without {other[0]}, as nothing can be ended there")

    @property
    def limits(self) -> CallLimits:
        """Of one call."""
        memory = None if self.memory_limit is None else int(self.memory_limit * GIGABYTE)
        patience = PATIENCE if self.patience is None else self.patience
        return CallLimits(time=self.time_limit, memory=memory, patience=patience)

    @contextmanager
    def kept(self, *modules: str) -> Iterator[Engine]:
        """The same engine, whose local processes are kept from one use to the next.

        Args:
            modules: that the first process loads while this one goes on; none starts before it is needed without them.

        Yields:
            The engine; all its processes end with this.
        """
        if self.in_process or self.dask or self.idle:
            yield self
            return
        idle = Idle()
        try:
            if modules:
                idle.start(modules)
            yield replace(self, idle=idle)
        finally:
            idle.stop()

    def each(
        self, function: Callable[[Item, Tell], Outcome], items: Iterable[Item], heard: Heard = unheard
    ) -> Generator[tuple[int, Outcome | Lost], None, None]:
        """function(item, tell) of each item.

        Args:
            function: that a new process can import; tells the outcomes of an item's parts, in their order.
            items: plain data; taken one by one as there is room, so that millions may come from a generator.
            heard: is told about each part in between; but not what happens on a cluster.

        Yields:
            Number of the item and its outcome, in the order in which they finish.

        Raises:
            InputError: no such cluster, or one that runs another version of the code.
            OccError: that the function has raised; an item that raises anything else is lost.
        """
        if self.in_process:
            return _here(function, items, heard)
        return _submitted(self._calls(), function, items, heard)

    def each_or_parts(
        self,
        function: Callable[[Item | Part, Tell], Outcome],
        items: Iterable[Item],
        parts: Callable[[int], Sequence[Part]],
        heard: Heard = unheard,
    ) -> Generator[tuple[int, Outcome | Lost | list[Outcome | Lost]], None, None]:
        """function(item, tell) of each item, and of the missing parts of those that are lost.

        What goes wrong is lost alone, and what was told before is not made again.

        Args:
            function: as in `each`; of parts as well.
            items: as in `each`.
            parts: of the item of that number; empty where it has none.
            heard: is told about each part as soon as it is known; but not what happens on a cluster.

        Yields:
            Number of the item and its outcome, or the outcomes of its parts in their order.

        Raises:
            InputError: as in `each`.
            OccError: as in `each`.
        """
        divided: dict[int, list[Outcome | Lost]] = {}
        places: list[tuple[int, int]] = []
        again: list[Part] = []
        with closing(self.each(function, items, heard)) as finished:
            for number, outcome in finished:
                pieces = parts(number) if isinstance(outcome, Lost) else ()
                if not pieces:
                    yield number, outcome
                    continue
                assert isinstance(outcome, Lost)
                known = list(outcome.told)
                if outcome.silent and len(known) < len(pieces):
                    # This one has had its time.
                    known.append(replace(outcome, told=()))
                    heard(number, len(known) - 1, known[-1])
                if len(known) == len(pieces):
                    yield number, known
                    continue
                missing = range(len(known), len(pieces))
                divided[number] = [*known, *(outcome for _ in missing)]
                places += [(number, place) for place in missing]
                again += [pieces[place] for place in missing]
        left = Counter(number for number, _ in places)
        with closing(self.each(function, again)) as finished:
            for position, outcome in finished:
                number, place = places[position]
                divided[number][place] = outcome
                heard(number, place, outcome)
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
        crew = Crew(self.limits, self.idle)
        with ThreadPoolExecutor(self.workers) as executor:
            try:
                yield _LocalCalls(crew, executor, self.workers)
            finally:
                executor.shutdown(wait=False, cancel_futures=True)
                crew.stop()


class _Calls(Protocol):
    """An executor of `concurrent.futures` whose calls are made in processes of their own."""

    def submit(self, function: Function, item: Any, heard: Tell) -> Future[Any]: ...

    def capacity(self) -> int: ...

    def outcome(self, future: Future[Any]) -> Any: ...


@dataclass(frozen=True)
class _LocalCalls:
    crew: Crew
    executor: ThreadPoolExecutor
    workers: int

    def submit(self, function: Function, item: Any, heard: Tell) -> Future[Any]:
        return self.executor.submit(self.crew.call, function, item, heard)

    def capacity(self) -> int:
        return self.workers

    def outcome(self, future: Future[Any]) -> Any:
        return future.result()


def _here(
    function: Callable[[Item, Tell], Outcome], items: Iterable[Item], heard: Heard
) -> Generator[tuple[int, Outcome | Lost], None, None]:
    # Each of them brings a library of linear algebra of its own, which must be there to be limited.
    import casadi  # noqa: F401 - to be there
    import scipy.linalg  # noqa: F401 - to be there
    from threadpoolctl import ThreadpoolController

    libraries = ThreadpoolController()
    for number, item in enumerate(items):
        told: list[Any] = []

        def tell(part: Any, number: int = number, told: list[Any] = told) -> None:
            told.append(part)
            heard(number, len(told) - 1, part)

        with libraries.limit(limits=1):
            try:
                outcome: Outcome | Lost = function(item, tell)
            except OccError:
                raise
            except Exception as error:  # whatever an item does, the others go on
                outcome = replace(raised(error), told=tuple(told))
        yield number, outcome


class _Told(NamedTuple):
    """What a call has told, before it is done."""

    number: int
    part: Any


def _submitted(
    opened: Any, function: Callable[[Item, Tell], Outcome], items: Iterable[Item], heard: Heard
) -> Generator[tuple[int, Outcome | Lost], None, None]:
    waiting = enumerate(items)
    running: dict[Future[Any], int] = {}
    places: Counter[int] = Counter()
    news: SimpleQueue[_Told | Future[Any]] = SimpleQueue()
    with opened as calls:
        while True:
            while len(running) < calls.capacity():
                following = next(waiting, None)
                if following is None:
                    break
                number, item = following
                future = calls.submit(function, item, lambda part, number=number: news.put(_Told(number, part)))
                running[future] = number
                future.add_done_callback(news.put)
            if not running:
                return
            told = news.get()
            if isinstance(told, _Told):
                heard(told.number, places[told.number], told.part)
                places[told.number] += 1
            else:
                number = running.pop(told)
                places.pop(number, None)
                yield number, calls.outcome(told)
