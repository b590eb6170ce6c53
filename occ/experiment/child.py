"""Processes of their own for one call at a time: one that crashes, hangs or fills the memory costs its own call only.

The pools of the standard library lose all running calls when one process dies and have no time limits, and a worker of
dask, being a daemon, may not start them.  Here a process is an interpreter that reads calls from its input and writes
answers to its output; killing it is always safe.  While a call is being made it tells what is finished of it: whoever
waits sees that it goes on, and what was told outlives the process.
"""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

from occ.errors import OccError

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""What libraries of linear algebra read when they are loaded."""
WATCH = 0.5
"""[s] A process whose parent is gone ends after this time."""
GARBAGE = 50_000
"""New objects between two looks for cyclic garbage: what a process keeps from case to case is large and has none."""
PROGRAM = "import sys; sys.path[:] = eval(sys.argv[1]); from occ.experiment.child import serve; {}serve()"
LONGEST_WAIT = 1e6
"""[s] What the operating system can wait for at once."""

Tell = Callable[[Any], None]
"""Takes what is finished of a call, plain data."""
Function = Callable[[Any, Tell], Any]
"""Of an item; it may tell what is finished of it while it goes on."""


@dataclass(frozen=True)
class Lost:
    """A call without an answer.

    Args:
        reason: in words.
        told: what the call had told before, in its order.
        silent: whether it was ended because nothing was heard of it.
    """

    reason: str
    told: tuple[Any, ...] = ()
    silent: bool = False


@dataclass(frozen=True, kw_only=True)
class CallLimits:
    """What one call may take.

    Args:
        time: [s] None is no limit.
        memory: [byte] address space of its process; None is no limit.
        patience: [s] how long nothing may be heard of it; None is for ever.
    """

    time: float | None = None
    memory: int | None = None
    patience: float | None = None


def unheard(_: Any) -> None:
    """A `Tell` to which nobody listens."""


class Idle:
    """Processes that wait for calls; threads may use it at the same time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._children: list[_Child] = []

    def start(self, modules: Sequence[str]) -> None:
        """One more, which loads modules while this process does something else.

        Args:
            modules: by their full names.
        """
        self.give(_Child(modules))

    def give(self, child: _Child) -> None:
        """One more."""
        with self._lock:
            self._children.append(child)

    def take(self) -> _Child:
        """One of them, or a new one; those that have died while they waited are cleared away."""
        with self._lock:
            while self._children:
                child = self._children.pop()
                if child.alive:
                    return child
                child.kill()
        return _Child()

    def stop(self) -> None:
        """End all of them."""
        with self._lock:
            while self._children:
                self._children.pop().kill()


class Crew:
    """Processes that are kept from call to call; as many are started as calls are running at once.

    Args:
        limits: of each call.
        idle: where processes come from and stay, also when the crew has stopped; the crew's own by default.
    """

    def __init__(self, limits: CallLimits, idle: Idle | None = None) -> None:
        self._limits = limits
        self._lock = threading.Lock()
        self._idle, self._owns = idle or Idle(), idle is None
        self._busy: set[_Child] = set()
        self._stopped = False

    def call(self, function: Function, item: Any, heard: Tell = unheard) -> Any:
        """function(item, tell) in a process of its own; threads may call this at the same time.

        Args:
            function: that a new process can import.
            item: plain data.
            heard: is told, here, what the function tells there.

        Returns:
            Its answer, or `Lost` where the process died or a limit was passed.

        Raises:
            OccError: that the function has raised; any other error of its is an answer that is `Lost`.
        """
        with self._lock:
            if self._stopped:
                return Lost("stopped before it began")
            child = self._idle.take()
            self._busy.add(child)
        try:
            return child.call(function, item, self._limits, heard)
        finally:
            with self._lock:
                self._busy.discard(child)
                if child.alive and not self._stopped:
                    self._idle.give(child)
                else:
                    child.kill()

    def stop(self) -> None:
        """End all calls, and the processes that are the crew's own."""
        with self._lock:
            self._stopped = True
            # Whoever waits for their answers clears them away.
            for child in self._busy:
                child.end()
        if self._owns:
            self._idle.stop()


class _Child:
    """One process and the pipes to it."""

    def __init__(self, modules: Sequence[str] = ()) -> None:
        self.overdue: Lost | None = None
        requests, self.requests = Pipe(duplex=False)
        self.answers, answers = Pipe(duplex=False)
        self.process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM.format("".join(f"import {name}; " for name in modules)), repr(sys.path)],
            stdin=requests.fileno(),
            stdout=answers.fileno(),
            env=os.environ | dict.fromkeys(THREADS, "1"),
            # An interrupt from the keyboard is the parent's business, and what a call starts is ended with it.
            start_new_session=True,
        )
        requests.close()
        answers.close()

    @property
    def alive(self) -> bool:
        return self.overdue is None and self.process.poll() is None

    def call(self, function: Function, item: Any, limits: CallLimits, heard: Tell) -> Any:
        told: list[Any] = []
        end = None
        try:
            self.requests.send((limits.memory, function, item))
            while True:
                kind, content = self._next(limits, end)
                if kind == "told":
                    told.append(content)
                    heard(content)
                elif kind == "begun":
                    # Libraries are loaded before the clock runs.
                    end = time.monotonic() + limits.time if limits.time else None
                else:
                    break
        except (EOFError, OSError):
            return replace(self.overdue or Lost(self._reason()), told=tuple(told))
        if kind == "error":
            raise content
        return replace(content, told=tuple(told)) if isinstance(content, Lost) else content

    def _next(self, limits: CallLimits, end: float | None) -> Any:
        """The next word of a call, which has to be finished at a time; EOFError where there is none."""
        now = time.monotonic()
        last = now + limits.patience if limits.patience else None
        until = min((moment for moment in (end, last) if moment is not None), default=None)
        while until is None or now < until:
            if self.answers.poll(LONGEST_WAIT if until is None else min(until - now, LONGEST_WAIT)):
                return self.answers.recv()
            now = time.monotonic()
        if until == end:
            self.overdue = Lost(f"not finished after {limits.time:g} s, the time limit")
        else:
            self.overdue = Lost(
                f"nothing was heard of it for {limits.patience:g} s, and it was taken for hung; what takes longer "
                "needs more --patience",
                silent=True,
            )
        raise EOFError

    def _reason(self) -> str:
        code = self.process.wait()
        if code >= 0:
            return f"the process that solved it ended with the exit code {code}"
        name = signal.Signals(-code).name
        hint = "; perhaps the machine ran out of memory" if -code == signal.SIGKILL else ""
        return f"the process that solved it was ended by the signal {name}{hint}"

    def end(self) -> None:
        # Together with whatever it has started.
        if self.process.poll() is None:
            with suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)

    def kill(self) -> None:
        self.end()
        self.process.wait()
        self.requests.close()
        self.answers.close()


def serve() -> None:
    """Answer calls until the input ends; this is what a process of a `Crew` does."""
    with Connection(os.dup(0), writable=False) as requests, Connection(os.dup(1), readable=False) as answers:
        # What a function prints must not get between the answers.
        os.dup2(2, 1)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
        gc.set_threshold(GARBAGE)
        while True:
            try:
                memory, function, item = requests.recv()
            except EOFError:
                return
            if memory is not None:
                _limit_memory(memory)
            answers.send(("begun", None))
            answers.send(_answer(function, item, lambda content: answers.send(("told", content))))


def _answer(function: Function, item: Any, tell: Tell) -> tuple[str, Any]:
    try:
        return "answer", function(item, tell)
    except OccError as error:
        # The user's business: it ends the run.
        return "error", error
    except Exception as error:  # whatever a call does, the others go on
        return "answer", raised(error)


def raised(error: Exception) -> Lost:
    """What stands for a call that has raised.

    Args:
        error: of any kind.

    Returns:
        Its kind and its words on one line.
    """
    return Lost(" ".join(f"{type(error).__name__}: {error}".split()))


def _limit_memory(size: int) -> None:
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (size, size))


def _end_with_parent(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(WATCH)
    # Together with whatever it has started.
    os.killpg(0, signal.SIGKILL)
