#!/usr/bin/python3
"""Checks `itn import`: renders a scene in Mitsuba 3, and what itn makes of it in itn.

    check_mitsuba_import.py [SCENE.xml ...] ...

They must agree in the luminance of every tile of 8 x 8 pixels and of the whole image, by z-tests
with Sidak's correction. Without SCENE.xml, three scenes are written and checked. Mitsuba's rays
start a little off surfaces, so dense media are darker there, up to 1 % in a scene of the size 1;
its reconstruction filter must be a box.

Installs Mitsuba from the package index that pip is configured for into a virtual environment
(Debian: python3-venv).

Exit codes: 0 both agree, 1 they do not, or an error, 2 command line, 77 skipped since something is
missing.
"""
import argparse
import pathlib
import shlex
import subprocess
import sys
import tempfile

from renderer_setup import MITSUBA, enter_virtual_environment

ROOT = pathlib.Path(__file__).resolve().parents[2]

BOARD = """
<shape type="rectangle">
  <transform name="to_world"><rotate x="1" angle="-90"/><scale value="4"/></transform>
  <bsdf type="twosided"><bsdf type="diffuse"><texture type="checkerboard" name="reflectance">
    <float name="color0" value="0.2"/><float name="color1" value="0.7"/>
    <transform name="to_uv"><scale x="8" y="8"/></transform></texture></bsdf></bsdf>
</shape>"""
CAMERA = """
<sensor type="perspective">
  <float name="fov" value="30"/><string name="fov_axis" value="y"/>
  <float name="principal_point_offset_x" value="0.05"/>
  <transform name="to_world"><lookat origin="2, 3, -6" target="0, 0.7, 0" up="0, 1, 0"/></transform>
  <sampler type="independent"><integer name="sample_count" value="64"/></sampler>
  <film type="hdrfilm"><integer name="width" value="96"/><integer name="height" value="64"/>
    <integer name="crop_offset_x" value="8"/><integer name="crop_offset_y" value="4"/>
    <integer name="crop_width" value="80"/><integer name="crop_height" value="56"/>
    <rfilter type="box"/></film>
</sensor>"""
MEDIUM = """
<medium type="homogeneous" name="interior">
  <float name="sigma_t" value="4"/><float name="albedo" value="0.8"/>
  <phase type="hg"><float name="g" value="0.3"/></phase></medium>"""
MICROFACETS = '<string name="distribution" value="ggx"/><float name="alpha" value="0.4"/>'
SCENES = {
    "lamps": f"""<scene version="3.0.0">
      <integrator type="volpath"><integer name="max_depth" value="-1"/></integrator>
      <shape type="ply"><string name="filename" value="mug.ply"/>
        <boolean name="face_normals" value="true"/>
        <transform name="to_world"><rotate y="1" angle="30"/><scale value="1.5"/>
          <translate y="0.1"/></transform>
        <bsdf type="null"/>{MEDIUM}</shape>{BOARD}
      <shape type="sphere"><point name="center" x="1.2" y="2.2" z="-1"/>
        <float name="radius" value="0.3"/>
        <emitter type="area"><float name="radiance" value="6"/></emitter></shape>
      <shape type="rectangle"><transform name="to_world"><scale x="0.5" y="0.4"/>
        <lookat origin="-1.5, 1.5, 0" target="0, 0.5, 0" up="0, 1, 0"/></transform>
        <emitter type="area"><float name="radiance" value="5"/></emitter></shape>
      <shape type="cube"><transform name="to_world"><scale value="0.2"/><rotate y="1" angle="20"/>
        <translate x="1.3" y="0.2" z="-0.6"/></transform>
        <bsdf type="diffuse"><float name="reflectance" value="0.6"/></bsdf></shape>
      <emitter type="constant"><float name="radiance" value="0.1"/></emitter>
      <emitter type="directional"><vector name="direction" x="-0.4" y="-1" z="0.7"/>
        <float name="irradiance" value="0.8"/></emitter>
      <emitter type="point"><point name="position" x="0" y="2.5" z="1"/>
        <float name="intensity" value="0.6"/></emitter>{CAMERA}</scene>""",
    **{name: f"""<scene version="3.0.0">
      <integrator type="volpath"><integer name="max_depth" value="-1"/></integrator>
      <shape type="ply"><string name="filename" value="mug.ply"/>
        <boolean name="face_normals" value="true"/>
        <transform name="to_world"><translate y="0.1"/></transform>
        <bsdf type="{name}">{microfacets}<float name="int_ior" value="1.4"/>
          <float name="ext_ior" value="1"/></bsdf>{MEDIUM}</shape>{BOARD}
      <shape type="cube"><transform name="to_world"><scale x="0.2" y="0.3" z="0.2"/>
        <rotate y="1" angle="25"/><translate x="-0.9" y="0.4" z="-0.3"/></transform>
        <bsdf type="{name}">{microfacets}<float name="int_ior" value="1.2"/>
          <float name="ext_ior" value="1"/></bsdf>
        <medium type="homogeneous" name="interior">
          <float name="sigma_t" value="7"/><float name="albedo" value="0.95"/>
          <phase type="hg"><float name="g" value="0.6"/></phase></medium></shape>
      <shape type="sphere"><point name="center" x="1.2" y="2.2" z="-1"/>
        <float name="radius" value="0.8"/>
        <emitter type="area"><float name="radiance" value="3"/></emitter></shape>
      <emitter type="constant"><float name="radiance" value="0.5"/></emitter>{CAMERA}</scene>"""
       for name, microfacets in {"dielectric": "", "roughdielectric": MICROFACETS}.items()},
}


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", type=pathlib.Path, nargs="*", metavar="SCENE.xml")
    parser.add_argument("--repetitions", type=int, default=16, metavar="N",
                        help="independent runs that variances are computed from (default: 16)")
    parser.add_argument("--spp", type=int, default=128,
                        help="samples per pixel of a run (default: 128)")
    parser.add_argument("--itn", type=pathlib.Path, metavar="FILE",
                        default=ROOT / "build/release/bin/itn",
                        help="itn to check (default: that of build/release)")
    parser.add_argument("--venv", type=pathlib.Path, metavar="DIR",
                        default=ROOT / "build/mitsuba-venv",
                        help="virtual environment with Mitsuba; made when absent "
                             "(default: build/mitsuba-venv)")
    arguments = parser.parse_args()
    if arguments.repetitions < 3:
        parser.error("--repetitions: a variance wants 3 at least")
    for file in [arguments.itn, *arguments.scenes]:
        if not file.exists():
            parser.error(f"{file} is not there")
    return arguments


ARGUMENTS = parse_arguments()
enter_virtual_environment(ARGUMENTS.venv, MITSUBA, "numpy")

import mitsuba as mi  # noqa: E402
import numpy as np  # noqa: E402
from tiles import agree, tiles  # noqa: E402

mi.set_variant("scalar_rgb")


def run(*command):
    return subprocess.run([ARGUMENTS.itn, *command], check=True, text=True,
                          stdout=subprocess.PIPE).stdout


def ours(scene, folder):
    """Runs x tiles, by the command that `itn import` prints."""
    said = run("import", scene, "-o", folder / "scene.textproto")
    print(said, end="")
    command = shlex.split(said.split("render it: itn ")[1])
    if "--spp" in command:
        at = command.index("--spp")
        del command[at:at + 2]
    images = []
    for seed in range(ARGUMENTS.repetitions):
        run(*command, "--spp", str(ARGUMENTS.spp), "--seed", str(seed), "--quiet")
        bitmap = mi.Bitmap(str(folder / "scene.exr"))
        names = [bitmap.struct_()[i].name for i in range(bitmap.channel_count())]
        images.append(tiles(np.array(bitmap, float)[..., names.index("Y")]))
    return np.array(images)


def theirs(scene):
    loaded = mi.load_file(str(scene))
    return np.array([tiles(np.array(mi.render(loaded, seed=seed, spp=ARGUMENTS.spp),
                                    float)[..., :3] @ [0.2126, 0.7152, 0.0722])
                     for seed in range(ARGUMENTS.repetitions)])


def check(scene, folder):
    return agree(scene.name, ours(scene, folder), theirs(scene))


def main():
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        scenes = ARGUMENTS.scenes
        if not scenes:
            run("shapes", "--output", folder, "--quiet")
            for scene, text in SCENES.items():
                (folder / f"{scene}.xml").write_text(text, encoding="ascii")
            scenes = [folder / f"{scene}.xml" for scene in SCENES]
        if not all([check(scene, folder) for scene in scenes]):
            print("DISAGREEMENT between itn and Mitsuba", file=sys.stderr)
            sys.exit(1)


if __name__ == "__main__":
    main()
