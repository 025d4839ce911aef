"""Render workers, which the program `itn relay` asks, so that gRPC is not in this process."""

from __future__ import annotations

import atexit
import contextlib
import os
import socket
import tempfile
import threading
import weakref
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from . import _core, programs
from .errors import Error, InvalidInput, Unavailable

#: Addresses of workers (docs/operations.md): one, or several, or with commas.
Workers = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]

# Relays that are kept for the next call.
_MOST_IDLE = 8


class _Relay:
    """The program as a child. One call at a time uses it."""

    def __init__(self, addresses: str):
        self.asks = _asks(addresses)
        self._messages = tempfile.TemporaryFile()
        self._said = 0  # bytes of them that were warned of
        self._lock = threading.Lock()  # guards that
        ours, theirs = socket.socketpair()
        with ours, theirs:
            words = ["relay", "--quiet", f"--workers={addresses}"]
            self._child = programs.start(words, theirs.fileno(), theirs.fileno(), self._messages)
            self.core = _core.Relay(ours.detach())
        _all.add(self)

    def runs(self) -> bool:
        return self._child.poll() is None

    def _messages_from(self, start: int) -> bytes:
        """Without moving the child to another place in the file."""
        size = os.fstat(self._messages.fileno()).st_size
        return os.pread(self._messages.fileno(), size - start, start) if size > start else b""

    def warn(self) -> None:
        """Of what it has logged since the last time."""
        with self._lock:
            whole, end, _ = self._messages_from(self._said).rpartition(b"\n")
            self._said += len(whole + end)
        programs.warn_of(programs.logged(whole.decode("utf-8", "replace")))

    def end(self, at_once: bool = True) -> Error | None:
        """Returns the error with which it has ended by itself, if it has."""
        self.core.close()
        in_time = programs.end(self._child, interrupt=at_once)
        with self._messages:
            if not in_time or self._child.returncode == 0:
                return None
            said = self._messages_from(0).decode("utf-8", "replace")
            return programs.error_of("relay", self._child.returncode, programs.logged(said, False))

    def drop(self) -> None:
        """After it has ended, or where it is the parent's of this process."""
        self._child.returncode = 0
        self._messages.close()


def _asks(addresses: str) -> tuple[str, str, frozenset[tuple[str, str]]]:
    """What a relay's connections follow from: addresses may be paths, and variables say how to connect."""
    variables = frozenset((name, value) for name, value in os.environ.items() if name.startswith("ITN_"))
    return addresses, os.getcwd(), variables


_lock = threading.Lock()
_idle: list[_Relay] = []
_all: weakref.WeakSet[_Relay] = weakref.WeakSet()


@atexit.register
def _end_all() -> None:
    while _idle:
        _idle.pop().end()


def _forget() -> None:
    global _lock
    _lock = threading.Lock()
    for relay in list(_all):
        relay.core.forget()
        relay.drop()
    _idle.clear()


os.register_at_fork(after_in_child=_forget)


class Asked:
    """What renders ask workers by: nothing, or a relay that nobody else uses meanwhile."""

    def __init__(self, relay: _Relay | None = None):
        self._relay = relay
        self.core = relay.core if relay is not None else None

    def progress(self, progress: Callable[[float], Any] | None) -> Callable[[float], Any] | None:
        """The same, which also warns of what the relay says."""
        if self._relay is None:
            return progress
        relay = self._relay

        def said(fraction: float) -> None:
            relay.warn()
            if progress is not None:
                progress(fraction)

        return said


@contextlib.contextmanager
def asked(workers: Workers | Asked | None) -> Iterator[Asked]:
    """Where something is raised meanwhile, what is under way is given up. Raises Unavailable, InvalidInput."""
    if workers is None:
        yield Asked()
        return
    if isinstance(workers, Asked):
        yield workers
        return
    addresses = addresses_of(workers)
    relay = _take(addresses) or _Relay(addresses)
    try:
        yield Asked(relay)
        relay.warn()
    except Unavailable as error:
        raise relay.end(at_once=False) or error from None
    except BaseException:
        relay.end()
        raise
    with _lock:
        keep = len(_idle) < _MOST_IDLE
        if keep:
            _idle.append(relay)
    if not keep:
        relay.end()


def addresses_of(workers: Workers) -> str:
    """With commas. Raises InvalidInput."""
    several = [workers] if isinstance(workers, (str, os.PathLike)) else workers
    if isinstance(several, (list, tuple)) and all(isinstance(one, (str, os.PathLike)) for one in several):
        addresses = [address.strip() for one in several for address in str(os.fspath(one)).split(",")]
        if addresses and all(addresses):
            return ",".join(addresses)
    raise InvalidInput(f"workers {workers!r}: they are an address, as 'host:50051' or 'unix:/run/w', or a list of some")


def _take(addresses: str) -> _Relay | None:
    with _lock:
        for relay in [relay for relay in _idle if not relay.runs()]:
            _idle.remove(relay)
            relay.drop()
        found = next((relay for relay in reversed(_idle) if relay.asks == _asks(addresses)), None)
        if found is not None:
            _idle.remove(found)
        return found
