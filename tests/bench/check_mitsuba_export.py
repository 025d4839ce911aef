#!/usr/bin/python3
"""Checks a material exported for Mitsuba 3: renders it there, and the predicted material in itn.

    check_mitsuba_export.py FILE --material SIGMA_T,ALBEDO,G [--material ... --material ...] ...

FILE is what itn wrote in the format "mitsuba" from these materials: one for gray, or those of R, G
and B. It is included in a scene of Mitsuba, as a user would; itn renders the same scene of a 1 mm
object with each of the materials. They must agree in every pixel of the object and in their mean,
by z-tests with Sidak's correction. If the channels differ in g, the exported material is only
similar to them, and what is printed is the size of that approximation.

Mitsuba starts rays a little off surfaces; see compare_mitsuba.py, whose remedy is also used here:
the scene is rendered at two sizes and extrapolated to no offset.

Installs Mitsuba from the package index that pip is configured for into a virtual environment
(Debian: python3-venv). Mitsuba needs libLLVM 16 or later (Debian: libllvm19), found by
DRJIT_LIBLLVM_PATH or below /usr/lib.

Exit codes: 0 both agree, 1 they do not, or an error, 2 command line, 77 skipped since something is
missing.
"""
import argparse
import pathlib
import subprocess
import sys
import tempfile
import xml.etree.ElementTree

from renderer_setup import MITSUBA, enter_virtual_environment, find_llvm

ROOT = pathlib.Path(__file__).resolve().parents[2]

ON_OBJECT = 0.99    # a pixel counts if at least so much of it shows the object
FAMILY_WISE = 1e-3  # probability that a comparison fails by chance, for all of them together


def material(text):
    values = tuple(float(part) for part in text.split(","))
    if len(values) != 3:
        raise argparse.ArgumentTypeError(f"{text}: must be SIGMA_T,ALBEDO,G")
    return values


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=pathlib.Path, metavar="FILE", help="exported material")
    parser.add_argument("--material", type=material, action="append", required=True,
                        metavar="SIGMA_T,ALBEDO,G", dest="materials",
                        help="what was exported, sigma_t in 1/mm; once, or for each of R, G, B")
    parser.add_argument("--mm-per-scene-unit", type=float, default=1,
                        help="as FILE was exported (default: 1)")
    parser.add_argument("--object-size-mm", type=float, default=1,
                        help="likewise; 1 if the size was unknown (default: 1)")
    parser.add_argument("--shape", default="mug", help="one of `itn shapes` (default: mug)")
    parser.add_argument("--repetitions", type=int, default=16, metavar="N",
                        help="independent runs that variances are computed from (default: 16)")
    parser.add_argument("--spp", type=int, default=256,
                        help="samples per pixel of a run (default: 256)")
    parser.add_argument("--size", type=int, default=24,
                        help="width and height of the image, in pixels (default: 24)")
    parser.add_argument("--itn", type=pathlib.Path, metavar="FILE",
                        default=ROOT / "build/release/bin/itn",
                        help="itn to compare with (default: that of build/release)")
    parser.add_argument("--venv", type=pathlib.Path, metavar="DIR",
                        default=ROOT / "build/mitsuba-venv",
                        help="virtual environment with Mitsuba; made when absent "
                             "(default: build/mitsuba-venv)")
    arguments = parser.parse_args()
    if len(arguments.materials) not in (1, 3):
        parser.error("--material: once for gray, or three times for R, G, B")
    if arguments.repetitions < 3:
        parser.error("--repetitions: a variance wants 3 at least")
    if not arguments.itn.exists():
        parser.error(f"--itn: {arguments.itn} is not there; deploy/build.sh builds it")
    if not arguments.file.exists():
        parser.error(f"{arguments.file} is not there")
    return arguments


ARGUMENTS = parse_arguments()
find_llvm()
enter_virtual_environment(ARGUMENTS.venv, MITSUBA, "numpy")

import mitsuba as mi  # noqa: E402
import numpy as np  # noqa: E402
from welch import largest_by_chance, z_of_difference  # noqa: E402

GRAY = len(ARGUMENTS.materials) == 1
mi.set_variant("llvm_ad_mono" if GRAY else "llvm_ad_rgb")

# The scene: lit from everywhere, and more from one side; in mm, of an object of 1 mm.
SKY = 0.3
SUN, TO_SUN = 2, (1, 2, -1.5)
ORIGIN, TARGET, FIELD_OF_VIEW = (1.5, 2.5, -8), (0, .4, 0), 10


class Itn:
    def __init__(self, folder, mesh):
        self.folder = folder
        self.scene = f"{folder}/scene.textproto"
        with open(self.scene, "w", encoding="ascii") as file:
            file.write(f"""
                object {{ mesh {{ path: "{mesh}" normalize: true }} }}
                lights {{ constant {{ radiance: {SKY} }} }}
                lights {{ directional {{ direction {{ {self.vector(TO_SUN)} }}
                                         irradiance: {SUN} }} }}
                camera {{ origin {{ {self.vector(ORIGIN)} }} target {{ {self.vector(TARGET)} }}
                          fov_degrees: {FIELD_OF_VIEW} }}
                film {{ width: {ARGUMENTS.size} height: {ARGUMENTS.size} }}""")
        self.on_object = self.render(ARGUMENTS.materials[0], 0)["mask.Y"] >= ON_OBJECT

    @staticmethod
    def vector(values):
        return " ".join(f"{axis}: {value}" for axis, value in zip("xyz", values))

    def render(self, channel, seed):
        """Layers of the image by name."""
        sigma_t, albedo, g = map(str, channel)
        image = f"{self.folder}/image.exr"
        subprocess.run([ARGUMENTS.itn, "render", self.scene, "--output", image, "--quiet",
                        "--sigma-t", sigma_t, "--albedo", albedo, "--g", g,
                        "--spp", str(ARGUMENTS.spp), "--seed", str(seed)],
                       check=True, stdout=subprocess.DEVNULL)
        bitmap = mi.Bitmap(image)
        names = [bitmap.struct_()[i].name for i in range(bitmap.channel_count())]
        return dict(zip(names, np.moveaxis(np.array(bitmap, float), -1, 0)))

    def image(self, seed):
        """Channels x pixels of the object."""
        return np.array([self.render(channel, 100 * seed + i)["Y"][self.on_object]
                         for i, channel in enumerate(ARGUMENTS.materials)])


class Mitsuba:
    def __init__(self, folder, mesh, on_object, units_per_mm):
        """`units_per_mm`: length of the side of the 1 mm object. The exported medium, which is for
        another number, is scaled."""
        self.on_object = on_object
        transform = mi.ScalarTransform4f
        vertices = np.array(mi.traverse(mi.load_dict({"type": "ply", "filename": mesh}))
                            ["vertex_positions"]).reshape(-1, 3)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        middle = (low + high) / 2
        self.height = (high - low)[1] / (high - low).max()
        normalize = transform().scale(1 / float((high - low).max())).translate(
            [-middle[0], -low[1], -middle[2]])
        # The object's centre is the origin, where the offset of rays is smallest.
        place = transform().scale(units_per_mm).translate([0, -self.height / 2, 0])
        origin, target = (place @ mi.ScalarPoint3f(point) for point in (ORIGIN, TARGET))

        name = xml.etree.ElementTree.parse(ARGUMENTS.file).find("medium").get("id")
        path = f"{folder}/scene.xml"
        with open(path, "w", encoding="ascii") as file:
            file.write(f"""<scene version="3.0.0">
                <include filename="{ARGUMENTS.file.resolve()}"/>
                <shape type="ply" id="object">
                    <string name="filename" value="{mesh}"/>
                    <boolean name="face_normals" value="true"/>
                    <transform name="to_world">
                        <matrix value="{self.numbers((place @ normalize).matrix)}"/></transform>
                    <ref id="{name}_boundary"/>
                    <ref name="interior" id="{name}"/>
                </shape>
                <emitter type="constant"><float name="radiance" value="{SKY}"/></emitter>
                <emitter type="directional">
                    <vector name="direction" value="{self.numbers(-np.array(TO_SUN))}"/>
                    <float name="irradiance" value="{SUN}"/></emitter>
                <sensor type="perspective">
                    <float name="fov" value="{FIELD_OF_VIEW}"/><string name="fov_axis" value="x"/>
                    <float name="near_clip" value="{units_per_mm}"/>
                    <float name="far_clip" value="{100 * units_per_mm}"/>
                    <transform name="to_world"><lookat origin="{self.numbers(origin)}"
                        target="{self.numbers(target)}" up="0, 1, 0"/></transform>
                    <sampler type="independent">
                        <integer name="sample_count" value="{ARGUMENTS.spp}"/></sampler>
                    <film type="hdrfilm">
                        <integer name="width" value="{ARGUMENTS.size}"/>
                        <integer name="height" value="{ARGUMENTS.size}"/><rfilter type="box"/>
                        <string name="pixel_format" value="{'luminance' if GRAY else 'rgb'}"/>
                        <string name="component_format" value="float32"/></film>
                </sensor></scene>""")
        self.scene = mi.load_file(path)
        exported_units_per_mm = ARGUMENTS.object_size_mm / ARGUMENTS.mm_per_scene_unit
        parameters = mi.traverse(self.scene)
        scale, = (key for key in parameters.keys() if key.endswith(".scale"))
        parameters[scale] = parameters[scale] * exported_units_per_mm / units_per_mm
        parameters.update()
        self.integrator = mi.load_dict({"type": "volpath" if GRAY else "volpathmis",
                                        "max_depth": -1, "rr_depth": 20})
        # As compare_mitsuba.py derives it.
        self.offset = 1 / units_per_mm + np.abs(
            (vertices - low) / (high - low).max() - [0, self.height / 2, 0]).max(axis=1).mean()

    @staticmethod
    def numbers(values):
        return ", ".join(f"{value:.9g}" for value in np.array(values, float).ravel())

    def image(self, seed):
        image = np.array(mi.render(self.scene, integrator=self.integrator, seed=seed), float)
        return np.moveaxis(image, -1, 0)[:len(ARGUMENTS.materials), self.on_object]


FINE, COARSE = 1000., 0.25  # units per mm: hardly any offset, and a larger one


def render_both():
    """Runs x channels x pixels of itn, and of Mitsuba without its offset of rays."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([ARGUMENTS.itn, "shapes", "--output", folder, "--quiet"], check=True,
                       stdout=subprocess.DEVNULL)
        mesh = f"{folder}/{ARGUMENTS.shape}.ply"
        itn = Itn(folder, mesh)
        fine, coarse = (Mitsuba(folder, mesh, itn.on_object, units) for units in (FINE, COARSE))
        weight = fine.offset / (coarse.offset - fine.offset)
        runs = range(1, ARGUMENTS.repetitions + 1)
        ours = np.array([itn.image(run) for run in runs])
        theirs = np.array([(1 + weight) * fine.image(2 * run) - weight * coarse.image(2 * run + 1)
                           for run in runs])
        return ours, theirs


def main():
    ours, theirs = render_both()
    scores = {}
    for channel, name in enumerate(["Y"] if GRAY else ["R", "G", "B"]):
        a, b = ours[:, channel], theirs[:, channel]
        of_pixels = z_of_difference(b, a)
        of_mean = float(z_of_difference(b.mean(axis=1), a.mean(axis=1)))
        means, errors = zip(*((runs.mean(), runs.mean(axis=1).std(ddof=1) / np.sqrt(len(runs)))
                              for runs in (a, b)))
        difference = means[1] - means[0]
        error = np.hypot(*errors)
        print(f"{name}: mean over {a.shape[1]} pixels: itn {means[0]:.6f} +- {errors[0]:.6f}, "
              f"Mitsuba {means[1]:.6f} +- {errors[1]:.6f}; difference "
              f"{100 * difference / means[0]:+.3f} % +- {100 * error / means[0]:.3f} %, "
              f"z = {of_mean:+.2f}; pixels: largest |z| {np.abs(of_pixels).max():.2f}, "
              f"mean of z^2 {np.mean(of_pixels ** 2):.2f}")
        scores |= {f"{name}, pixel {i}": float(z) for i, z in enumerate(of_pixels)}
        scores[f"{name}, mean"] = of_mean
    limit = largest_by_chance(len(scores), FAMILY_WISE)
    worst = max(scores, key=lambda name: abs(scores[name]))
    print(f"worst of {len(scores)} comparisons: {worst}, z = {scores[worst]:+.2f}; chance alone "
          f"exceeds {limit:.2f} once in {1 / FAMILY_WISE:.0f} runs")
    # Negated so that NaN fails too.
    if not all(abs(z) < limit for z in scores.values()):
        print("DISAGREEMENT between itn and Mitsuba", file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
