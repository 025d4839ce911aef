#!/usr/bin/env python3
"""Examines sources with clang-tidy (.clang-tidy): tidy.py [--paths] BUILD_FOLDER [FILE...].

--paths: also what may happen along each path through a function (clang-analyzer-*), which costs two
thirds of the time.

Default: of the files of tidy_files.txt those that have changed in the last 50 commits, or that
include what has; where git does not know, all. The list is to be extended by what passes. It leaves
out what includes LibTorch, gRPC, CLI11 or all of Highway's targets, as each such file costs from half
a minute to several, and what clang 14 cannot read (the views of libstdc++ 12, lambdas that capture
structured bindings). A file that has passed is not examined again until it, or something of ours
that it includes, changes.

Exit code 77, skipped: no clang-tidy 14, the one of Debian 12, or no compilation database.
"""
import argparse
import concurrent.futures
import functools
import hashlib
import json
import os
import pathlib
import re
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
LISTED = ROOT / "tests/style/tidy_files.txt"
FOR_CLANG = ROOT / "tests/fuzz/libtorch_under_clang.h"


@functools.lru_cache(maxsize=None)
def includes(path):
    """The files of ours that one includes itself."""
    ours = set()
    for name in re.findall(r'^#include "([^"]+)"', path.read_text(), re.MULTILINE):
        generated = ROOT / "proto" / re.sub(r"(\.grpc)?\.pb\.h$", ".proto", name)
        ours |= {file for file in (ROOT / name, generated) if file.is_file()}
    return ours


def closure(path):
    """The files of ours that one includes, directly or not, itself included."""
    seen, waiting = set(), [path]
    while waiting:
        file = waiting.pop()
        if file not in seen:
            seen.add(file)
            waiting += includes(file)
    return seen


def key(path, checks):
    """Changes when the result may."""
    digest = hashlib.sha256((ROOT / ".clang-tidy").read_bytes() + FOR_CLANG.read_bytes() +
                            checks.encode())
    for file in sorted(closure(path)):
        digest.update(str(file.relative_to(ROOT)).encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


def git(*arguments):
    """What it prints, by line. Throws OSError or CalledProcessError."""
    return subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True, text=True,
                          check=True).stdout.splitlines()


def changed_lately():
    """The files of ours that are not what they were 50 commits ago; None if that is unknown."""
    try:
        if pathlib.Path(git("rev-parse", "--show-toplevel")[0]).resolve() != ROOT:
            return None
        names = git("diff", "--name-only", "HEAD~50", "--")
        names += git("ls-files", "--others", "--exclude-standard")
    except (OSError, subprocess.CalledProcessError):
        return None
    return {ROOT / name for name in names}


def listed_files():
    files = [ROOT / name for name in LISTED.read_text().split()]
    changed = changed_lately()
    if changed is None or {ROOT / ".clang-tidy", LISTED} & changed:
        return files
    return [file for file in files if closure(file) & changed]


def compiled_together(entry):
    """The sources of ours that are compiled by an entry of the database."""
    if "/batches/" not in entry["file"]:
        return [entry["file"]]
    names = re.findall(r'^#include "([^"]+)"', pathlib.Path(entry["file"]).read_text(), re.MULTILINE)
    return [str(ROOT / name) for name in names]


def write_database(build, folder):
    """The compilation database, each source by itself, with what clang needs in the place of what GCC
    has read of LibTorch."""
    entries = [{**entry, "file": file, "command": entry["command"].replace(entry["file"], file)}
               for entry in json.loads((build / "compile_commands.json").read_text())
               for file in compiled_together(entry)]
    for entry in entries:
        command = re.sub(r" -Wno-subobject-linkage| -Winvalid-pch -include \S+cmake_pch\.hxx", "", entry["command"])
        if "/torch/" in command:
            command += f" -include {FOR_CLANG}"
        entry["command"] = command
    (folder / "compile_commands.json").write_text(json.dumps(entries))


def examine(path, checks, passed):
    stamp = passed / key(path, checks)
    if stamp.exists():
        return 0, "", 0.0
    start = time.monotonic()
    result = subprocess.run(["clang-tidy", "-p", str(passed), "--quiet", "--checks=" + checks, str(path)],
                            capture_output=True, text=True, check=False)
    if result.returncode == 0:
        stamp.touch()
    return result.returncode, result.stdout + result.stderr, time.monotonic() - start


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--paths", action="store_true")
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("files", nargs="*")
    arguments = parser.parse_args()
    build = arguments.build.resolve()
    checks = "" if arguments.paths else "-clang-analyzer-*"
    try:
        version = subprocess.run(["clang-tidy", "--version"], capture_output=True, text=True,
                                 check=True).stdout
    except OSError:
        version = ""
    if "version 14." not in version or not (build / "compile_commands.json").is_file():
        print("skipped: needs clang-tidy 14 and compile_commands.json")
        return 77
    files = [ROOT / name for name in arguments.files] or listed_files()
    passed = build / "tidy"
    passed.mkdir(exist_ok=True)
    write_database(build, passed)
    failures = 0
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        results = pool.map(lambda path: examine(path, checks, passed), files)
        for path, (code, output, seconds) in zip(files, results):
            if seconds > 0:
                print(f"{path.relative_to(ROOT)}: {seconds:.1f} s", flush=True)
            if code != 0:
                failures += 1
                print(output, flush=True)
    print(f"{len(files)} files, {failures} with findings")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
