#!/usr/bin/python3
"""Fits a homogeneous medium by gradient descent, with itn.torch and with Mitsuba 3: the same scene file, the same
optimiser, steps and samples, on the same cores.

    compare_mitsuba_fit.py [--runs N] [--steps N] [--spp N] [--json]

Each fits its own image of many samples, so that what the renderers differ by does not count. The figure is the time
until sigma_t and albedo are within 3 % and 1 % of the truth on average over the last ten steps; where one does not get
there, it says so. Runs of both alternate.

Installs Mitsuba and PyTorch from the package index that pip is configured for into a virtual environment (Debian:
python3-venv). Mitsuba needs libLLVM 16 or later (Debian: libllvm19). itn is taken from build/release/python.

Exit codes: 0, 2 command line, 77 skipped since something is missing.
"""

import argparse
import json
import pathlib
import statistics
import sys
import tempfile
import time

from renderer_setup import MITSUBA, enter_virtual_environment, find_llvm, skip

ROOT = pathlib.Path(__file__).resolve().parents[2]
SIGMA_T, ALBEDO, G = 20.0, 0.9, 0.4
NEAR = (0.03, 0.01)
SCENE = """<scene version="3.0.0">
  <integrator type="prbvolpath"><integer name="max_depth" value="-1"/><integer name="rr_depth" value="100"/></integrator>
  <shape type="cube" id="cube">
    <transform name="to_world"><scale value="0.5"/><rotate y="1" angle="30"/><translate y="0.51"/></transform>
    <bsdf type="null"/>
    <medium name="interior" type="homogeneous" id="medium">
      <float name="sigma_t" value="20"/><float name="albedo" value="0.9"/><phase type="hg"><float name="g" value="0.4"/></phase>
    </medium>
  </shape>
  <shape type="rectangle">
    <transform name="to_world"><rotate x="1" angle="-90"/><scale value="6"/></transform>
    <bsdf type="diffuse"><float name="reflectance" value="0.5"/></bsdf>
  </shape>
  <shape type="rectangle">
    <transform name="to_world"><scale value="0.8"/><lookat origin="-2, 2.5, 1" target="0, 0.5, 0" up="0, 1, 0"/></transform>
    <emitter type="area"><float name="radiance" value="8"/></emitter>
  </shape>
  <emitter type="constant"><float name="radiance" value="0.4"/></emitter>
  <sensor type="perspective">
    <float name="fov" value="18"/>
    <transform name="to_world"><lookat origin="1, 2.2, -4.5" target="0, 0.5, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="64"/><rfilter type="box"/></film>
  </sensor>
</scene>
"""


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5, help="of each, with other random numbers (default: 5)")
    parser.add_argument("--steps", type=int, default=120, help="of Adam (default: 120)")
    parser.add_argument("--spp", type=int, default=32, help="of the image and of its gradient (default: 32)")
    parser.add_argument(
        "--venv",
        type=pathlib.Path,
        default=ROOT / "build/mitsuba-fit-venv",
        metavar="DIR",
        help="virtual environment; made when absent (default: build/mitsuba-fit-venv)",
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    return parser.parse_args()


ARGUMENTS = parse_arguments()
sys.path.insert(0, str(ROOT / "build/release/python"))
find_llvm()
enter_virtual_environment(ARGUMENTS.venv, MITSUBA, "torch")
try:
    import drjit as dr
    import itn
    import itn.torch
    import mitsuba as mi
    import torch
except ImportError as error:
    skip(str(error))
mi.set_variant("llvm_ad_mono")


def fit_with_itn(path, seed, steps, note):
    scene = itn.load(path)
    target = torch.from_numpy(itn.render(scene, sigma_t=SIGMA_T, albedo=ALBEDO, g=G, spp=4096, seed=12345).image)
    log_sigma_t, logit_albedo = (torch.tensor(v, requires_grad=True) for v in (1.6, 0.0))
    optimizer = torch.optim.Adam([log_sigma_t, logit_albedo], lr=0.1)
    note(None)
    for step in range(steps):
        optimizer.zero_grad()
        image = itn.torch.render(
            scene,
            {"sigma_t": log_sigma_t.exp(), "albedo": logit_albedo.sigmoid(), "g": G},
            spp=ARGUMENTS.spp,
            seed=seed * 1000 + step,
        )
        (image - target).square().mean().backward()
        optimizer.step()
        note((log_sigma_t.exp().item(), logit_albedo.sigmoid().item()))


def fit_with_mitsuba(path, seed, steps, note):
    scene = mi.load_file(path)
    target = mi.render(scene, spp=4096, seed=12345)
    dr.eval(target)
    params = mi.traverse(scene)
    sigma_t, albedo = (next(key for key in params.keys() if f"medium.{name}" in key) for name in ("sigma_t", "albedo"))
    optimizer = mi.ad.Adam(lr=0.1)
    optimizer["sigma_t"], optimizer["albedo"] = mi.Float(1.6), mi.Float(0.0)
    dr.sync_thread()
    note(None)
    for step in range(steps):
        params[sigma_t] = dr.exp(optimizer["sigma_t"])
        params[albedo] = 1 / (1 + dr.exp(-optimizer["albedo"]))
        params.update()
        image = mi.render(
            scene, params, spp=ARGUMENTS.spp, seed=2 * (seed * 1000 + step), seed_grad=2 * (seed * 1000 + step) + 1
        )
        loss = dr.mean(dr.square(image - target), axis=None)
        dr.backward(loss)
        optimizer.step()
        note((dr.exp(optimizer["sigma_t"])[0], 1 / (1 + dr.exp(-optimizer["albedo"]))[0]))


def measure(fit, path, seed, steps=ARGUMENTS.steps):
    """(seconds, sigma_t, albedo) after each step."""
    begun, way = None, []

    def note(found):
        nonlocal begun
        if found is None:
            begun = time.perf_counter()
        else:
            way.append((time.perf_counter() - begun, *found))

    fit(path, seed, steps, note)
    return way


def seconds_until_near(way):
    for last in range(9, len(way)):
        last_ten = way[last - 9 : last + 1]
        errors = [
            abs(statistics.fmean(step[1 + i] for step in last_ten) / truth - 1)
            for i, truth in enumerate((SIGMA_T, ALBEDO))
        ]
        if all(error < near for error, near in zip(errors, NEAR)):
            return way[last][0]
    return None


def main():
    with tempfile.TemporaryDirectory() as folder:
        path = f"{folder}/scene.xml"
        pathlib.Path(path).write_text(SCENE)
        measure(fit_with_mitsuba, path, 999, steps=2)  # compiles its kernels, which it keeps
        ways = {"itn": [], "mitsuba": []}
        for run in range(ARGUMENTS.runs):
            ways["itn"].append(measure(fit_with_itn, path, run))
            ways["mitsuba"].append(measure(fit_with_mitsuba, path, run))
    found = {}
    for name, of_name in ways.items():
        until = [seconds_until_near(way) for way in of_name]
        last = [
            [
                statistics.fmean(step[1 + i] for step in way[-20:]) / truth - 1
                for i, truth in enumerate((SIGMA_T, ALBEDO))
            ]
            for way in of_name
        ]
        found[name] = {
            "seconds_until_near": until,
            "seconds_a_step": statistics.median(way[-1][0] / len(way) for way in of_name),
            "error_sigma_t": [e[0] for e in last],
            "error_albedo": [e[1] for e in last],
        }
    if ARGUMENTS.json:
        print(json.dumps(found))
        return
    for name, of_name in found.items():
        reached = [s for s in of_name["seconds_until_near"] if s is not None]
        print(
            (
                f"{name:8} {1e3 * of_name['seconds_a_step']:.0f} ms a step; near after "
                f"{statistics.median(reached):.2f} s"
                if reached
                else f"{name:8} not near"
            ),
            f"({len(reached)} of {ARGUMENTS.runs} runs); in the end sigma_t is off by "
            f"{100 * statistics.fmean(of_name['error_sigma_t']):+.1f} %, albedo by "
            f"{100 * statistics.fmean(of_name['error_albedo']):+.1f} %",
        )


main()
