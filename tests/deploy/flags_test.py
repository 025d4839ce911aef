#!/usr/bin/env python3
"""Programs have every flag that the files of deploy/ give them."""
import os
import pathlib
import re
import subprocess
import sys

SOURCE = pathlib.Path(os.environ["ITN_SOURCE"])
PROGRAMS = pathlib.Path(os.environ["ITN_BIN"])
FILES = [
    "docker-compose.yml",
    "deploy/kubernetes/*.yaml",
    "deploy/slurm/*.sbatch",
    "deploy/systemd/*.service",
]
# What starts a command line, by its last words.
COMMANDS = {"itn-worker": ["itn-worker"], "itn-predictor": ["itn-predictor"], "probe": ["itn", "probe"]}
FOREIGN = ["node-exporter"]  # programs of others, whose flags are theirs to know


def flags_of(command):
    """The flags that the program explains."""
    arguments = [str(PROGRAMS / command[0]), *command[1:], "--help"]
    text = subprocess.run(arguments, check=True, capture_output=True, text=True).stdout
    return set(re.findall(r"--[a-z][a-z-]*", text))


def flags_given(path):
    """Commands, as keys of COMMANDS, with the flags that follow them in the file."""
    command = None
    text = re.sub(r"(^|\s)#.*", "", path.read_text())
    for word in re.findall(r"--[a-z][a-z-]*|[\w./@][\w./@-]*", text):
        if word.startswith("--") and command not in FOREIGN:
            yield command, word
        elif word.rpartition("/")[2] in [*COMMANDS, *FOREIGN]:
            command = word.rpartition("/")[2]


def main():
    known = {name: flags_of(command) for name, command in COMMANDS.items()}
    given = {
        (path, *pair)
        for pattern in FILES
        for path in SOURCE.glob(pattern)
        for pair in flags_given(path)
    }
    unknown = [(path, name, flag) for path, name, flag in given if flag not in known.get(name, ())]
    for path, name, flag in sorted(unknown, key=str):
        print(f"FAILED: {path.relative_to(SOURCE)}: {name} has no {flag}", file=sys.stderr)
    print(f"{len(given)} flags of {len({name for _, name, _ in given})} commands")
    return 1 if unknown or len({name for _, name, _ in given}) < len(COMMANDS) else 0


sys.exit(main())
