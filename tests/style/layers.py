#!/usr/bin/env python3
"""In the tracer, an include points to a room of the same name, or to one on a lower floor."""
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
TRACER = ROOT / "server/tracer"
# From the lowest floor up; rooms of one floor do not know each other.
FLOORS = [{"simd", "colour"}, {"random"}, {"phase", "boundary", "lights", "surfaces"}, {"parameters"}, {"geometry"}, {"scene"},
          {"request"}, {"film"}, {"collected"}, {"reference", "wavefront"}, {""}]
FLOOR_OF = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}

faults = []
for file in sorted(TRACER.rglob("*")):
    if file.suffix not in (".h", ".cpp"):
        continue
    room = file.relative_to(TRACER).parts[0] if file.parent != TRACER else ""
    for line in file.read_text().splitlines():
        found = re.match(r'#include "((?:server|client)/.*)"', line)
        if not found:
            continue
        parts = pathlib.PurePath(found[1]).parts
        if parts[:2] != ("server", "tracer"):
            faults.append(f"{file.relative_to(ROOT)}: the tracer does not know {found[1]}")
            continue
        other = parts[2] if len(parts) > 3 else ""
        if other != room and FLOOR_OF[other] >= FLOOR_OF[room]:
            faults.append(f"{file.relative_to(ROOT)}: {room or 'server/tracer'} must not include {found[1]}")
print("\n".join(faults))
sys.exit(1 if faults else 0)
