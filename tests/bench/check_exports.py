#!/usr/bin/python3
"""Checks what `itn materials` writes for Blender and for MaterialX in these programs themselves.

    check_exports.py [--blender] [--materialx]       (default: both)

MaterialX's own library reads the OpenPBR document, validates it, and declares every input that it
sets. Blender runs the script and renders a mug of marble in Cycles, index-matched and with smooth
and rough surfaces; itn renders the same. Their means over the object must agree to half a per cent,
beside 4 standard errors; a rougher surface is printed alone, as light that meets two microfacets
goes on differently there.

Installs them from the package index that pip is configured for into a virtual environment (Debian:
python3-venv). Blender as a module wants a certain Python: that of Debian 12 for 5.0.

Exit codes: 0 all is well, 1 it is not, or an error, 2 command line, 77 skipped since something is
missing.
"""
import argparse
import math
import pathlib
import re
import subprocess
import sys
import tempfile

from renderer_setup import enter_virtual_environment

ROOT = pathlib.Path(__file__).resolve().parents[2]
MATERIALX, BLENDER = "MaterialX==1.39.5", "bpy==5.0.1"

ORIGIN, TARGET, FIELD_OF_VIEW, SIZE = (1.5, 2.5, -8), (0, .4, 0), 10, 32
ON_OBJECT = 0.99  # a pixel counts if at least so much of it shows the object
TOLERANCE = 0.005
# Flags of `itn materials`, the boundary in a scene, whether they are to agree.
BOUNDARIES = {
    "index-matched": (["--index", "1"], "", True),
    "smooth": (["--index", "1.4"], "dielectric { index: 1.4 }", True),
    "roughness 0.1": (["--index", "1.4", "--roughness", "0.1"],
                      "rough_dielectric { index: 1.4 roughness: 0.1 }", True),
    "roughness 0.4": (["--index", "1.4", "--roughness", "0.4"],
                      "rough_dielectric { index: 1.4 roughness: 0.4 }", False)}


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--blender", action="store_true", help="Blender alone")
    parser.add_argument("--materialx", action="store_true", help="MaterialX alone")
    parser.add_argument("--repetitions", type=int, default=8, metavar="N",
                        help="independent renders that errors are computed from (default: 8)")
    parser.add_argument("--spp", type=int, default=128,
                        help="samples per pixel of each (default: 128)")
    parser.add_argument("--itn", type=pathlib.Path, metavar="FILE",
                        default=ROOT / "build/release/bin/itn",
                        help="itn to check (default: that of build/release)")
    parser.add_argument("--venv", type=pathlib.Path, metavar="DIR",
                        default=ROOT / "build/exports-venv",
                        help="virtual environment; made when absent (default: build/exports-venv)")
    arguments = parser.parse_args()
    if arguments.repetitions < 3:
        parser.error("--repetitions: a standard error wants 3 at least")
    if not arguments.itn.exists():
        parser.error(f"--itn: {arguments.itn} is not there; deploy/build.sh builds it")
    if not (arguments.blender or arguments.materialx):
        arguments.blender = arguments.materialx = True
    return arguments


ARGUMENTS = parse_arguments()
enter_virtual_environment(ARGUMENTS.venv, "numpy", *([MATERIALX] if ARGUMENTS.materialx else []),
                          *([BLENDER, "OpenEXR"] if ARGUMENTS.blender else []))

import numpy as np  # noqa: E402


def run(*command):
    return subprocess.run([ARGUMENTS.itn, *command], check=True, text=True,
                          stdout=subprocess.PIPE).stdout


def check_materialx(folder):
    import MaterialX as mx
    path = str(folder / "marble.mtlx")
    run("materials", "marble", "--format", "openpbr", "--roughness", "0.1", "--scene-unit", "cm",
        "-o", path)
    document, library = mx.createDocument(), mx.createDocument()
    mx.readFromXmlFile(document, path)
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
    document.importLibrary(library)
    valid, message = document.validate()
    shaders = [shader for material in document.getMaterialNodes()
               for shader in mx.getShaderNodes(material)]
    inputs = [(shader, value) for shader in shaders for value in shader.getInputs()]
    unknown = [value.getName() for shader, value in inputs
               if not shader.getNodeDef().getActiveInput(value.getName())]
    print(f"MaterialX {mx.getVersionString()}: valid: {valid} {message}; {len(shaders)} shaders, "
          f"{len(inputs)} inputs, not declared: {unknown}")
    converted = materialx_converts(document, library)
    return valid and len(shaders) == 2 and not unknown and converted


def materialx_converts(document, library):
    """Whether MaterialX's generator of shaders converts lengths in cm to the unit of a scene."""
    import MaterialX as mx
    import MaterialX.PyMaterialXGenGlsl as glsl
    import MaterialX.PyMaterialXGenShader as shading
    generator = glsl.GlslShaderGenerator.create()
    context = shading.GenContext(generator)
    context.registerSourceCodeSearchPath(mx.getDefaultDataSearchPath())
    distance = document.getUnitTypeDef("distance")
    converters = mx.UnitConverterRegistry.create()
    converters.addUnitConverter(distance, mx.LinearUnitConverter.create(distance))
    units = shading.UnitSystem.create(generator.getTarget())
    units.loadLibrary(library)
    units.setUnitConverterRegistry(converters)
    generator.setUnitSystem(units)
    converted = True
    for unit, factor in {"millimeter": 10, "meter": 0.01}.items():
        context.getOptions().targetDistanceUnit = unit
        for material in document.getMaterialNodes():
            code = generator.generate("shader", material, context).getSourceCode("pixel")
            found = [float(number) for number in
                     re.findall(r"uniform float \w+_unit_in2 = ([0-9.]+);", code)]
            print(f"MaterialX, scene in {unit}: lengths of {material.getName()} times {found}")
            converted &= len(found) == 1 and abs(found[0] - factor) < 1e-3 * factor
    return converted


def vector(values):
    return " ".join(f"{axis}: {value}" for axis, value in zip("xyz", values))


class Blender:
    """A scene of a mesh under a sky of radiance 1, without materials."""

    def __init__(self, mesh):
        import bpy
        import mathutils
        self.bpy = bpy
        bpy.ops.wm.read_factory_settings(use_empty=True)
        scene = self.scene = bpy.context.scene
        head, body = pathlib.Path(mesh).read_bytes().split(b"end_header\n", 1)
        counts = [int(line.split()[2]) for line in head.split(b"\n")
                  if line.startswith(b"element ")]
        vertices = np.frombuffer(body, "<f4", 3 * counts[0]).reshape(-1, 3)
        faces = np.frombuffer(body[vertices.nbytes:], [("n", "u1"), ("corners", "<u4", 3)],
                              counts[1])["corners"]
        self.mesh = bpy.data.meshes.new("mesh")
        self.mesh.from_pydata(vertices.tolist(), [], faces.tolist())
        scene.collection.objects.link(bpy.data.objects.new("object", self.mesh))
        scene.world = bpy.data.worlds.new("sky")
        scene.world.use_nodes = True
        tree = scene.world.node_tree
        tree.nodes.clear()
        sky, output = map(tree.nodes.new, ("ShaderNodeBackground", "ShaderNodeOutputWorld"))
        sky.inputs["Color"].default_value = (1, 1, 1, 1)
        tree.links.new(sky.outputs[0], output.inputs[0])
        lens = bpy.data.cameras.new("camera")
        lens.sensor_fit, lens.angle = "HORIZONTAL", math.radians(FIELD_OF_VIEW)
        scene.camera = bpy.data.objects.new("camera", lens)
        scene.collection.objects.link(scene.camera)
        origin = mathutils.Vector(ORIGIN)
        back = (origin - mathutils.Vector(TARGET)).normalized()
        right = mathutils.Vector((0, 1, 0)).cross(back).normalized()
        scene.camera.matrix_world = mathutils.Matrix(
            (right, back.cross(right), back)).transposed().to_4x4()
        scene.camera.matrix_world.translation = origin
        scene.render.engine = "CYCLES"
        cycles = scene.cycles
        cycles.device, cycles.samples, cycles.pixel_filter_type = "CPU", ARGUMENTS.spp, "BOX"
        cycles.use_adaptive_sampling = cycles.use_denoising = False
        cycles.sample_clamp_indirect = cycles.blur_glossy = 0
        for bounces in ("max", "volume", "transmission", "glossy", "diffuse", "transparent_max"):
            setattr(cycles, f"{bounces}_bounces", 1024)
        scene.render.resolution_x = scene.render.resolution_y = SIZE
        scene.render.image_settings.file_format = "OPEN_EXR"
        scene.render.image_settings.color_depth = "32"

    def images(self, script, path):
        """Runs x rows x columns x channels."""
        before = set(self.bpy.data.materials)
        exec(compile(script.read_text(), script, "exec"), {"__name__": "__main__"})
        material, = set(self.bpy.data.materials) - before
        self.mesh.materials.clear()
        self.mesh.materials.append(material)
        self.scene.render.filepath = str(path)
        result = []
        for self.scene.cycles.seed in range(ARGUMENTS.repetitions):
            self.bpy.ops.render.render(write_still=True)
            image = self.bpy.data.images.load(str(path))
            result.append(np.array(image.pixels).reshape(SIZE, SIZE, 4)[::-1, :, :3])
            self.bpy.data.images.remove(image)
        return np.array(result)


def check_blender(folder):
    import OpenEXR
    run("shapes", "--output", folder, "--quiet")
    blender = Blender(folder / "mug.ply")
    well = True
    for name, (flags, boundary, must_agree) in BOUNDARIES.items():
        script, scene = folder / "marble.py", folder / "scene.textproto"
        run("materials", "marble", "--format", "blender", *flags, "-o", script)
        scene.write_text(f"""object {{ mesh {{ path: "mug.ply" }} {boundary} }}
            lights {{ constant {{ radiance: 1 }} }}
            camera {{ origin {{ {vector(ORIGIN)} }} target {{ {vector(TARGET)} }}
                      fov_degrees: {FIELD_OF_VIEW} }}
            film {{ width: {SIZE} height: {SIZE} }}""", encoding="ascii")
        ours = []
        for seed in range(ARGUMENTS.repetitions):
            run("render", scene, "-o", folder / "itn.exr", "--material", "marble", "--color",
                "--spp", str(ARGUMENTS.spp), "--seed", str(seed), "--quiet")
            layers = OpenEXR.File(str(folder / "itn.exr"), separate_channels=True).channels()
            ours.append(np.stack([layers[c].pixels for c in "RGB"], axis=-1))
        on_object = layers["mask.Y"].pixels >= ON_OBJECT
        theirs = blender.images(script, folder / "blender.exr")
        means = [runs[:, on_object].mean(axis=1) for runs in (np.array(ours), theirs)]
        difference = means[1].mean(axis=0) / means[0].mean(axis=0) - 1
        error = np.hypot(*(of.std(axis=0, ddof=1) / len(of) ** 0.5 / of.mean(axis=0)
                           for of in means))
        print(f"Blender {blender.bpy.app.version_string}, {name}: differences in R, G, B: "
              + ", ".join(f"{100 * d:+.2f} +- {100 * e:.2f} %" for d, e in zip(difference, error)))
        well &= not must_agree or bool(np.all(np.abs(difference) < TOLERANCE + 4 * error))
    return well


def main():
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        well = not ARGUMENTS.materialx or check_materialx(folder)
        well &= not ARGUMENTS.blender or check_blender(folder)
    sys.exit(0 if well else 1)


if __name__ == "__main__":
    main()
