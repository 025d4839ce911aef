"""What itn raises, and warns of. Every message says what is wrong, where, and what would be right."""

from __future__ import annotations

import contextlib
import os
import sys
import warnings
from collections.abc import Iterator


class Error(Exception):
    """The base of all; by itself a fault of itn's."""


class InvalidInput(Error, ValueError):
    """A value, a scene, a mesh or an image cannot be used."""


class FileError(Error, OSError):
    """A file is missing, cannot be read or written, or is damaged."""


class LimitExceeded(Error):
    """The renderer, or a worker, does not take so much at a time."""


class Unavailable(Error):
    """No worker or predictor answers."""


class Cancelled(Error):
    """What was under way was cancelled from another thread, or as Python ended."""


def warn(message: str) -> None:
    """Warns where the caller of the package is."""
    package = os.path.dirname(__file__)
    frame, level = sys._getframe(), 1
    while frame.f_back is not None and (
        os.path.dirname(frame.f_code.co_filename) == package
        or frame.f_code.co_filename == contextlib.__file__
        or frame.f_globals.get("__name__", "").startswith("torch.")
    ):
        frame, level = frame.f_back, level + 1
    warnings.warn(message, stacklevel=level)


@contextlib.contextmanager
def writing(path: str | os.PathLike[str]) -> Iterator[str]:
    """The name of a temporary file, which becomes `path` if all goes well. Raises FileError."""
    name = os.fspath(path)
    temporary = f"{name}.{os.getpid()}.part"
    try:
        yield temporary
        os.replace(temporary, name)
    except OSError as error:
        raise FileError(f"cannot write {name}: {error.strerror or error}") from None
    except ValueError as error:  # of a name with a NUL
        raise InvalidInput(f"cannot write {name!r}: {error}") from None
    finally:
        with contextlib.suppress(OSError, ValueError):
            os.unlink(temporary)
