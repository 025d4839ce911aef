"""The programs of itn as child processes: what needs LibTorch, gRPC or files of cameras is in them."""

from __future__ import annotations

import atexit
import contextlib
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import IO, Any

from . import _core
from .errors import Cancelled, Error, FileError, InvalidInput, LimitExceeded, Unavailable, warn

# docs/errors.md
_OF_EXIT_CODE = {
    2: InvalidInput,
    3: InvalidInput,
    4: FileError,
    5: Unavailable,
    6: FileError,
    7: LimitExceeded,
    130: Cancelled,
}
# What itn-learn needs that a wheel does not hold (deploy/wheel.sh).
_LIBRARIES = ("libtorch1.13", "libopenblas0-pthread", "libopenimageio2.4", "libopencv-photo406", "libheif1")
# What the programs put before a line that they log.
_LOGGED = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d+ (?:warning|error|info) ")


def find(name: str) -> str:
    """The path of a program of itn: in the folder that the variable ITN_BIN names, or of the package, of its build, or
    on the PATH."""
    package = pathlib.Path(__file__).parent
    # In a build the files of the package are links, but the folder is the build's.
    folders = [os.environ.get("ITN_BIN"), package / "bin", pathlib.Path(_core.__file__).absolute().parents[2] / "bin"]
    for folder in folders:
        if folder and os.access(pathlib.Path(folder) / name, os.X_OK):
            return str(pathlib.Path(folder) / name)
    if found := shutil.which(name):
        return found
    raise FileError(f"there is no program {name}: the variable ITN_BIN names the folder of itn's programs")


def arguments(flags: dict[str, Any]) -> list[str]:
    """Flags of a command line by their names in Python: object_size=82 is --object-size 82. None and False are no
    flag, True is one without a value, of several values there is a list with commas, and a dictionary is a flag with
    NAME=VALUE for each."""
    given = []
    for name, value in flags.items():
        if value is None or value is False:
            continue
        flag = "--" + name.replace("_", "-")
        if isinstance(value, dict):
            given += [word for key, held in value.items() for word in (flag, f"{key}={float(held)!r}")]
            continue
        given.append(flag)
        if value is True:
            continue
        several = isinstance(value, Sequence) and not isinstance(value, str) or hasattr(value, "tolist")
        values = value.tolist() if hasattr(value, "tolist") else value
        values = values if several and isinstance(values, Sequence) else [values]
        given.append(
            ",".join(
                os.fspath(v) if isinstance(v, os.PathLike) else repr(float(v)) if isinstance(v, float) else str(v)
                for v in values
            )
        )
    return given


def run(
    command: str,
    positional: Sequence[str],
    flags: dict[str, Any],
    *,
    names: Mapping[str, str] | None = None,
    warns: bool = True,
    accepts: Collection[int] = (),
    watch: Callable[[], Any] | None = None,
) -> str:
    """Runs a command of itn and returns what it prints. What it warns of are warnings here. Ctrl-C ends it. `names`:
    what messages call files that the user did not name. `accepts`: exit codes that are no error where something was
    printed. `watch`: is called all the time; what it raises ends the command."""
    if "help" in flags:
        raise InvalidInput("help: docs/reference/commands.md says what flags there are")
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as messages:
        words = [command, *arguments({"quiet": True, **flags}), "--", *positional]
        child = start(words, subprocess.DEVNULL, output, messages)
        _children.add(child)
        try:
            while True:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    child.wait(timeout=0.05 if watch is not None else None)
                    break
                if watch is not None:
                    watch()
        except BaseException:
            end(child)
            raise
        finally:
            _children.discard(child)
        said = with_names(text_of(messages), names or {})
        printed = text_of(output)
        if child.returncode != 0 and not (printed and child.returncode in accepts):
            raise error_of(command, child.returncode, said)
        if warns:
            warn_of(said)
        return printed


def start(
    words: Sequence[str], stdin: int, stdout: int | IO[bytes], stderr: int | IO[bytes]
) -> subprocess.Popen[bytes]:
    """The program itn as a child, which Ctrl-C in a terminal does not reach."""
    for word in words:
        if "\0" in word:
            raise InvalidInput(f"{word!r}: it has a NUL")
    return subprocess.Popen([find("itn"), *words], stdin=stdin, stdout=stdout, stderr=stderr, start_new_session=True)


def error_of(command: str, code: int, said: str) -> Error:
    """That a command ended with this exit code, and said this."""
    lines = _lines(said)
    if missing := [line for line in lines if "error while loading shared libraries" in line]:
        return FileError(
            f"{missing[0]}. Networks and photographs need libraries of Debian 12: apt-get install "
            "--no-install-recommends " + " ".join(_LIBRARIES)
        )
    if code < 0:
        return Error(f"itn {command} was ended by signal {-code}")
    mistakes = "\n".join(line for line in lines if "Run with --help" not in line)
    return _OF_EXIT_CODE.get(code, Error)(mistakes or f"itn {command} ended with exit code {code}")


def logged(said: str, are_logged: bool = True) -> str:
    """The lines that a program has logged while it ran, or the others."""
    return "\n".join(line for line in said.splitlines() if bool(_LOGGED.match(line)) is are_logged)


def warn_of(said: str) -> None:
    for line in _lines(said):
        warn(line)


def _lines(said: str) -> list[str]:
    return [_LOGGED.sub("", line).removeprefix("itn: ") for line in said.splitlines() if line.strip()]


def with_names(text: str, names: Mapping[str, str]) -> str:
    """A message with names in the place of paths; of paths that begin alike, the longest first."""
    for path in sorted(names, key=len, reverse=True):
        text = text.replace(path, names[path])
    return text


def text_of(file: IO[bytes]) -> str:
    file.seek(0)
    return file.read().decode("utf-8", "replace")


_children: set[subprocess.Popen[bytes]] = set()


@atexit.register
def _end_all() -> None:
    """Those of threads that Python leaves behind."""
    for child in list(_children):
        end(child)


def end(child: subprocess.Popen[bytes], interrupt: bool = True) -> bool:
    """As Ctrl-C in a shell does, or when it ends by itself; and for good if that takes long, which is False."""
    if interrupt:
        child.send_signal(signal.SIGINT)
    try:
        child.wait(timeout=5)
        return True
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()
        return False


def main() -> None:
    """Becomes the program itn, with the arguments of this process."""
    program = find("itn")
    os.execv(program, [program, *sys.argv[1:]])
