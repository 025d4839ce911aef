#!/usr/bin/env python3
"""What stands in common/ is reached from server/ and from client/, and neither from common/; the server knows no client."""
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
# One side alone reaches these, and why they are here:
ONE_SIDED = {
    "common/part_cache.h": "the tracer, which includes no other room of the server, and the scene compiler use it",
    "common/part_cache.cpp": "it is of part_cache.h",
}
SIDES = ("server", "client")
# All that the client knows of the server: rendering inside the program, and scenes as it understands them.
DOORS = ("server/renderer.h", "server/exports/mitsuba_scene.h", "server/render/render_server.h", "server/render/request_render.h")

includes = {}
for side in ("common", *SIDES):
    for file in sorted((ROOT / side).rglob("*")):
        if file.suffix in (".h", ".cpp"):
            includes[str(file.relative_to(ROOT))] = re.findall(r'^#include "([^"]+)"', file.read_text(), re.M)


def reached_from(side):
    """Files of common/ that a side includes, or that implement what it includes."""
    reached, ahead = set(), [file for file in includes if file.startswith(side + "/")]
    while ahead:
        file = ahead.pop()
        if file in reached or not file.startswith(("common/", side + "/")):
            continue
        reached.add(file)
        if file.endswith(".h"):
            ahead.append(file[:-2] + ".cpp")
        ahead += includes.get(file, [])
    return {file for file in reached if file in includes and file.startswith("common/")}


by_server, by_client = map(reached_from, SIDES)
faults = [f"{file}: {SIDES[file in by_client]}/ alone reaches it; it belongs there"
          for file in sorted((by_server ^ by_client) - ONE_SIDED.keys())]
faults += [f"tests/style/sides.py: both sides reach {file}, or none" for file in ONE_SIDED.keys() - (by_server ^ by_client)]
for file, included in includes.items():
    below = ("server/", "client/") if file.startswith("common/") else ("client/",) if file.startswith("server/") else ()
    faults += [f"{file}: it must not include {other}" for other in included if other.startswith(below)]
    if file.startswith("client/"):
        faults += [f"{file}: what clients may ask of the server is in {' and '.join(DOORS)}, not in {other}"
                   for other in included if other.startswith("server/") and other not in DOORS]
print("\n".join(faults))
sys.exit(1 if faults else 0)
