"""Processes of their own for one call at a time: one that crashes, hangs or fills the memory costs its own call only.

The pools of the standard library lose all running calls when one process dies and have no time limits, and a worker of
dask, being a daemon, may not start them.  Here a process is an interpreter that reads calls from its input and writes
answers to its output; killing it is always safe.
"""

from __future__ import annotations

import gc
import os
import pickle
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import IO, Any

from occ.errors import OccError

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""What libraries of linear algebra read when they are loaded."""
WATCH = 0.5
"""[s] A process whose parent is gone ends after this time."""
GARBAGE = 50_000
"""New objects between two looks for cyclic garbage: what a process keeps from case to case is large and has none."""
PROGRAM = "import sys; sys.path[:] = eval(sys.argv[1]); from occ.experiment.child import serve; serve()"
SIZE = struct.Struct("<Q")


@dataclass(frozen=True)
class Lost:
    """A call without an answer.

    Args:
        reason: in words.
    """

    reason: str


@dataclass(frozen=True, kw_only=True)
class CallLimits:
    """What one call may take.

    Args:
        time: [s] None is no limit.
        memory: [byte] address space of its process; None is no limit.
    """

    time: float | None = None
    memory: int | None = None


class Crew:
    """Processes that are kept from call to call; as many are started as calls are running at once.

    Args:
        limits: of each call.
    """

    def __init__(self, limits: CallLimits) -> None:
        self._limits = limits
        self._lock = threading.Lock()
        self._idle: list[_Child] = []
        self._busy: set[_Child] = set()
        self._stopped = False

    def call(self, function: Callable[[Any], Any], item: Any) -> Any:
        """function(item) in a process of its own; threads may call this at the same time.

        Args:
            function: that a new process can import.
            item: plain data.

        Returns:
            Its answer, or `Lost` where the process died or a limit was passed.

        Raises:
            OccError: that the function has raised; any other error of its is an answer that is `Lost`.
        """
        with self._lock:
            if self._stopped:
                return Lost("stopped before it began")
            child = self._waiting() or _Child(self._limits)
            self._busy.add(child)
        try:
            return child.call(function, item)
        finally:
            with self._lock:
                self._busy.discard(child)
                if child.alive and not self._stopped:
                    self._idle.append(child)
                else:
                    child.kill()

    def _waiting(self) -> _Child | None:
        """A process that waits for a call; those that have died while they waited are cleared away."""
        while self._idle:
            child = self._idle.pop()
            if child.alive:
                return child
            child.kill()
        return None

    def stop(self) -> None:
        """End all processes, in the middle of a call or not."""
        with self._lock:
            self._stopped = True
            children = [*self._idle, *self._busy]
            self._idle = []
        for child in children:
            child.kill()


class _Child:
    """One process and the pipes to it."""

    def __init__(self, limits: CallLimits) -> None:
        self.limits = limits
        self.overdue = False
        environment = os.environ | dict.fromkeys(THREADS, "1")
        self.process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, repr(sys.path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
            # An interrupt from the keyboard is the parent's business.
            start_new_session=True,
        )
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.requests, self.answers = self.process.stdin, self.process.stdout
        _send(self.requests, limits.memory)

    @property
    def alive(self) -> bool:
        return not self.overdue and self.process.poll() is None

    def call(self, function: Callable[[Any], Any], item: Any) -> Any:
        timer = threading.Timer(self.limits.time, self._end) if self.limits.time else None
        try:
            _send(self.requests, (function, item))
            # Libraries are loaded before the clock runs.
            _receive(self.answers)
            if timer:
                timer.start()
            kind, answer = _receive(self.answers)
        except (EOFError, OSError):
            return Lost(self._reason())
        finally:
            if timer:
                timer.cancel()
        if kind == "error":
            raise answer
        return answer

    def _end(self) -> None:
        self.overdue = True
        self.process.kill()

    def _reason(self) -> str:
        if self.overdue:
            return f"not finished after {self.limits.time:g} s, the time limit"
        code = self.process.wait()
        if code >= 0:
            return f"the process that solved it ended with the exit code {code}"
        name = signal.Signals(-code).name
        hint = "; perhaps the machine ran out of memory" if -code == signal.SIGKILL else ""
        return f"the process that solved it was ended by the signal {name}{hint}"

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()
        for pipe in (self.requests, self.answers):
            # Whoever reads the answer closes it with the error that the kill causes.
            try:
                pipe.close()
            except OSError:
                continue


def _send(pipe: IO[bytes], message: Any) -> None:
    body = pickle.dumps(message)
    pipe.write(SIZE.pack(len(body)))
    pipe.write(body)
    pipe.flush()


def _receive(pipe: IO[bytes]) -> Any:
    head = pipe.read(SIZE.size)
    if len(head) < SIZE.size:
        raise EOFError
    (size,) = SIZE.unpack(head)
    body = pipe.read(size)
    if len(body) < size:
        raise EOFError
    return pickle.loads(body)


def serve() -> None:
    """Answer calls until the input ends; this is what a process of a `Crew` does."""
    with os.fdopen(os.dup(0), "rb") as requests, os.fdopen(os.dup(1), "wb") as answers:
        # What a function prints must not get between the answers.
        os.dup2(2, 1)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
        gc.set_threshold(GARBAGE)
        memory = _receive(requests)
        if memory is not None:
            _limit_memory(memory)
        while True:
            try:
                function, item = _receive(requests)
            except EOFError:
                return
            _send(answers, "begun")
            _send(answers, _answer(function, item))


def _answer(function: Callable[[Any], Any], item: Any) -> tuple[str, Any]:
    try:
        return "answer", function(item)
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
    os._exit(1)
