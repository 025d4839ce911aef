#!/usr/bin/env bash
# The wheel in an environment of its own, outside of the repository, beside NumPy alone.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$root/deploy/wheel.sh" "$folder"
unset PYTHONPATH ITN_BIN
cd "$folder"
/usr/bin/python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check itn-*.whl
cp -r "$root/client/examples" .
venv/bin/python - <<'END'
import subprocess
import itn, itn.programs
scene = itn.load("examples/cube.textproto")
r = itn.render(scene, sigma_t=60, albedo=.8, g=.3, spp=16, derivatives=["sigma_t"])
assert r.image.shape == (128, 128) and r.image.mean() > 1, r
assert itn._core.__file__.startswith(itn.__path__[0])
scene.save("cube.xml", sigma_t=60, albedo=.8)
worker = subprocess.Popen([itn.programs.find("itn-worker"), "--listen", "unix:w"], stdout=subprocess.PIPE)
worker.stdout.readline()
there = itn.render(scene, sigma_t=60, albedo=.8, g=.3, spp=16, derivatives=["sigma_t"], workers="unix:w")
worker.terminate()
assert (there.image == r.image).all()
itn.predict("examples/mug.jpg", mask="examples/mug_mask.png").write("mug.mtlx")
print(r, itn.refine(r.image, scene, time_limit=5), sep="\n")
END
venv/bin/itn render examples/cube.textproto -o cube.exr --sigma-t 9 --albedo 0.5 --spp 1 --quiet
test -s mug.mtlx -a -s cube.exr -a -s cube.xml
