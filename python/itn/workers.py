"""Render workers, which the program `itn relay` asks, so that gRPC is not in this process."""

from __future__ import annotations

import atexit
import contextlib
import os
import socket
import subprocess
import tempfile
import threading
from collections.abc import Iterator, Sequence

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
        self._messages = tempfile.TemporaryFile("a+b")
        ours, theirs = socket.socketpair()
        with ours, theirs:
            self._child = subprocess.Popen(
                [programs.find("itn"), "relay", "--quiet", "--workers", addresses],
                stdin=theirs.fileno(),
                stdout=theirs.fileno(),
                stderr=self._messages,
                start_new_session=True,
            )
            self.core = _core.Relay(ours.detach())

    def runs(self) -> bool:
        return self._child.poll() is None

    def warn(self) -> None:
        """Of what it says that it has not said before."""
        programs.warn_of(programs.text_of(self._messages))
        self._messages.truncate(0)

    def end(self) -> None:
        """Raises the error with which it has ended by itself, if it has."""
        self.core.close()
        with self._messages:
            try:
                self._child.wait(timeout=5)
            except subprocess.TimeoutExpired:
                self._child.kill()
                self._child.wait()
                return
            if self._child.returncode != 0:
                raise programs.error_of("relay", self._child.returncode, programs.text_of(self._messages))

    def drop(self) -> None:
        """It has ended, or is the parent's of this process."""
        self._child.returncode = 0
        self._messages.close()


def _asks(addresses: str) -> tuple[str, str, frozenset[tuple[str, str]]]:
    """What a relay's connections follow from: addresses may be paths, and variables say how to connect."""
    variables = frozenset((name, value) for name, value in os.environ.items() if name.startswith("ITN_"))
    return addresses, os.getcwd(), variables


_lock = threading.Lock()
_idle: list[_Relay] = []


@atexit.register
def _end_all() -> None:
    while _idle:
        with contextlib.suppress(Error):
            _idle.pop().end()


def _forget() -> None:
    global _lock
    _lock = threading.Lock()
    while _idle:
        _idle.pop().drop()


os.register_at_fork(after_in_child=_forget)


@contextlib.contextmanager
def asked(workers: Workers | _core.Relay | None) -> Iterator[_core.Relay | None]:
    """A relay to the workers, which nobody else uses meanwhile; None if there are none. Where something is raised
    meanwhile, what is under way is given up. Raises Unavailable, InvalidInput."""
    if workers is None or isinstance(workers, _core.Relay):
        yield workers
        return
    several = [workers] if isinstance(workers, (str, os.PathLike)) else list(workers)
    addresses = ",".join(os.fspath(one) for one in several)
    if not addresses:
        raise InvalidInput("workers: there is none; it is an address, as 'host:50051' or 'unix:/run/w', or a list")
    relay = _take(addresses) or _Relay(addresses)
    try:
        yield relay.core
    except Unavailable:
        relay.end()
        raise
    except BaseException:
        with contextlib.suppress(Error):
            relay.end()
        raise
    with _lock:
        keep = len(_idle) < _MOST_IDLE
        if keep:
            relay.warn()
            _idle.append(relay)
    if not keep:
        relay.end()


def _take(addresses: str) -> _Relay | None:
    with _lock:
        for relay in [relay for relay in _idle if not relay.runs()]:
            _idle.remove(relay)
            relay.drop()
        found = next((relay for relay in reversed(_idle) if relay.asks == _asks(addresses)), None)
        if found is not None:
            _idle.remove(found)
        return found
