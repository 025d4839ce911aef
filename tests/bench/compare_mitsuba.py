#!/usr/bin/python3
"""Compares itn with Mitsuba 3 (LLVM variant) at equal error: the same scenes on the same cores.

    compare_mitsuba.py [--scenes REGEX] [--repetitions N] [--json] ...

Both render an object on a diffuse ground under the same environment map, and estimate the gradient
of the image loss in (sigma_t, albedo, g). Mitsuba renders only the box around the object; on both
sides only pixels of the object count. The two must agree, by z-tests; then the ratios of
variance x CPU time say how many times less CPU time itn takes for the same error.

Installs Mitsuba from the package index that pip is configured for into a virtual environment
(Debian: python3-venv). Mitsuba needs libLLVM 16 or later (Debian: libllvm19), found by
DRJIT_LIBLLVM_PATH or below /usr/lib. Beyond that: what client/examples/itn_client.py needs.

Exit codes: 0 both agree, 1 they do not, or an error, 2 command line, 77 skipped since something is
missing.
"""
import argparse
import dataclasses
import hashlib
import itertools
import json
import math
import os
import pathlib
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import time

from renderer_setup import MITSUBA, enter_virtual_environment, find_llvm, hold_to_avx2

ROOT = pathlib.Path(__file__).resolve().parents[2]

PARAMETERS = ("sigma_t", "albedo", "g")
# Shape and (sigma_t, albedo, g). Thin to thick; the paper's materials.
SCENES = [("armadillo", (30, .39, 0)), ("armadillo", (100, .87, .4)), ("armadillo", (100, .95, .5)),
          ("armadillo", (276, .95, .8)), ("bunny", (100, .87, .4)), ("cube", (100, .87, .4)),
          ("cube", (276, .95, .8))]
# Instead of a mesh that is not there.
STAND_INS = {"armadillo": "spiky ball", "bunny": "bumpy ball"}

ESTIMATES = 4           # K of the U-statistic in itn's loss gradient
PILOT_SPP = 4           # of the coarse render that tells itn where the noise is; in its CPU time
TARGET_SPP = 256
TARGET_SEED = 2 ** 40   # apart from the repetitions' seeds
ON_OBJECT = 0.99        # a pixel counts if at least so much of it shows the object
TILE = 8                # side of the squares of pixels that are compared, in pixels
FAMILY_WISE = 1e-3      # probability that a comparison fails by chance, for all of them together


# What must be there: arguments, Mitsuba, libLLVM.


def regular_expression(text):
    try:
        return re.compile(text)
    except re.error as error:
        raise argparse.ArgumentTypeError(f"{error}") from error


INDEX, ROUGHNESS = 1.5, 0.25
BOUNDARIES = ("matched", "rough", "smooth")


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=16, metavar="N",
                        help="independent runs that variances are computed from (default: 16)")
    parser.add_argument("--spp", type=int, default=64, help="samples per pixel (default: 64)")
    parser.add_argument("--size", type=int, default=128,
                        help="width and height of the image, in pixels (default: 128)")
    parser.add_argument("--threads", type=int, default=2, help="of each renderer (default: 2)")
    parser.add_argument("--scenes", type=regular_expression, default="", metavar="REGEX",
                        help="only scenes whose name matches, e.g. 'cube' or '100,' (default: all)")
    parser.add_argument("--boundary", choices=BOUNDARIES, default="matched",
                        help="of the object: matched, rough (1.5, alpha 0.25) or smooth (1.5) "
                             "(default: matched)")
    parser.add_argument("--avx2", action="store_true",
                        help="hold Mitsuba to AVX2 where the processor has more; the worker is to be "
                             "one that was built without AVX-512 (server/tracer/simd/targets.h)")
    parser.add_argument("--validation-data", type=pathlib.Path, metavar="DIR",
                        default=os.environ.get("ITN_VALIDATION_DATA"),
                        help="folder with meshes/armadillo.ply and meshes/bunny.ply; otherwise "
                             "balls stand in for them (default: $ITN_VALIDATION_DATA)")
    parser.add_argument("--worker-binary", type=pathlib.Path, metavar="FILE",
                        default=ROOT / "build/release/bin/itn-worker",
                        help="itn-worker to measure (default: that of build/release)")
    parser.add_argument("--proto", type=pathlib.Path, metavar="DIR", default=ROOT / "proto",
                        help="folder of the itn/v1/*.proto of that worker (default: proto)")
    parser.add_argument("--venv", type=pathlib.Path, metavar="DIR",
                        default=ROOT / "build/mitsuba-venv",
                        help="virtual environment with Mitsuba; made when absent "
                             "(default: build/mitsuba-venv)")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    arguments = parser.parse_args()
    if arguments.repetitions < 3:
        parser.error("--repetitions: a variance wants 3 at least")
    if not arguments.worker_binary.exists():
        parser.error(f"--worker-binary: {arguments.worker_binary} is not there; "
                     "deploy/build.sh builds it")
    return arguments


ARGUMENTS = parse_arguments()
find_llvm()
enter_virtual_environment(ARGUMENTS.venv, MITSUBA)

import drjit as dr  # noqa: E402
import grpc  # noqa: E402
import mitsuba as mi  # noqa: E402
import numpy as np  # noqa: E402
from welch import largest_by_chance, z_of_sum  # noqa: E402

mi.set_variant("llvm_ad_mono")
if ARGUMENTS.avx2:
    hold_to_avx2()
sys.path.insert(0, str(ROOT / "client/examples"))
import itn_client  # noqa: E402

MODULES = tempfile.TemporaryDirectory()
itn_client.compile_protos(ARGUMENTS.proto, MODULES.name)
from itn.v1 import render_pb2, render_pb2_grpc, scene_pb2  # noqa: E402


# The scene, for both.


@dataclasses.dataclass
class Scene:
    name: str
    vertices: np.ndarray  # n x 3, in mm
    triangles: np.ndarray
    material: tuple  # (sigma_t, albedo, g)

    @property
    def height(self):
        return float(self.vertices[:, 1].max())


# The object stands off the ground by this much, in mm: Mitsuba starts rays a little off the surface
# that they leave (see FINE), and would lose those that leave a face which lies in the ground.
GAP = 2e-3
GROUND_HALF_SIZE = 20
REFLECTANCE = 0.5
FIELD_OF_VIEW = 2.5  # in degrees


def cube():
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def ball(amplitude, frequency, rings=120):
    """Radius 1 + amplitude sin(frequency theta) sin(frequency phi)."""
    sectors = 2 * rings
    theta, phi = np.meshgrid(np.pi * np.arange(1, rings) / rings,
                             2 * np.pi * np.arange(sectors) / sectors, indexing="ij")
    radius = 1 + amplitude * np.sin(theta) * np.sin(frequency * theta) * np.sin(frequency * phi)
    body = radius * [np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)]
    vertices = np.vstack([body.reshape(3, -1).T, [[0, 1, 0], [0, -1, 0]]])
    north, south = len(vertices) - 2, len(vertices) - 1

    def vertex(ring, sector):
        return ring * sectors + sector % sectors

    triangles = []
    for s in range(sectors):
        triangles += [(north, vertex(0, s + 1), vertex(0, s)),
                      (south, vertex(rings - 2, s), vertex(rings - 2, s + 1))]
        for r in range(rings - 2):
            a, b = vertex(r, s), vertex(r, s + 1)
            c, d = vertex(r + 1, s), vertex(r + 1, s + 1)
            triangles += [(a, b, c), (b, d, c)]
    return vertices, np.array(triangles)


def read_mesh(path):
    mesh = mi.traverse(mi.load_dict({"type": "ply", "filename": str(path)}))
    return (np.array(mesh["vertex_positions"], float).reshape(-1, 3),
            np.array(mesh["faces"]).reshape(-1, 3))


def shape(name):
    """Vertices and triangles, over the origin, longest side 1 mm."""
    vertices, triangles = {"cube": cube, "bumpy ball": lambda: ball(.15, 4),
                           "spiky ball": lambda: ball(.4, 9)}.get(name, lambda: read_mesh(
                               ARGUMENTS.validation_data / f"meshes/{name}.ply"))()
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    base = [(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2]
    vertices = (vertices - base) / (high - low).max() + [0, GAP, 0]
    return vertices.astype("<f4"), triangles.astype("<u4")


def all_scenes():
    for name, material in SCENES:
        data = ARGUMENTS.validation_data
        if name in STAND_INS and not (data and (data / f"meshes/{name}.ply").exists()):
            name = STAND_INS[name]
        title = f"{name} {','.join(f'{p:g}'.replace('0.', '.') for p in material)}"
        if ARGUMENTS.scenes.search(title):
            yield Scene(title, *shape(name), material)


def panorama(width=512, height=256):
    """Something like sun and sky, in the layout of EnvironmentMap in scene.proto."""
    sun_elevation, sun_azimuth, sun_radius = np.radians([60, 30, 18.75])
    azimuth = 2 * np.pi * (np.arange(width) + .5) / width
    theta = np.pi * (np.arange(height)[:, None] + .5) / height
    y = np.cos(theta)
    cos_to_sun = (np.sin(theta) * np.cos(sun_elevation) * np.cos(azimuth - sun_azimuth)
                  + y * np.sin(sun_elevation))
    to_sun = np.arccos(np.clip(cos_to_sun, -1, 1))
    sky = .5 + .8 * (1 - y) ** 4 + .8 * np.exp(-3 * to_sun)
    # As bright as to give four times the sky's light.
    sun = np.where(to_sun < sun_radius, 30., 0)
    return np.where(y > 0, sky + sun, 0).astype("<f4")


LIGHT = panorama()


def with_rows_at_edges(panorama):
    """The same radiance in Mitsuba's layout, whose first and last row lie at the poles.

    It interpolates linearly between rows at v = j / (H - 1), ours at v = (i + 1/2) / h: H = 2 h + 1
    rows, every other one halfway between two of ours, are the same piecewise linear function."""
    height, width = panorama.shape
    rows = np.empty((2 * height + 1, width), "f4")
    rows[1::2] = panorama
    rows[2:-1:2] = (panorama[1:] + panorama[:-1]) / 2
    rows[0], rows[-1] = panorama[0], panorama[-1]
    return rows


def camera(scene):
    """Origin and target: 15 degrees above the horizon, as in the paper."""
    middle = scene.height / 2
    return (0, middle + 8.78, -32.8), (0, middle, 0)


# What is estimated. Each renderer has three methods, that return values and CPU seconds:
#   image(seed)            radiance of the object's pixels
#   mean_derivative(seed)  d (their mean) / d (sigma_t, albedo, g)
#   loss_gradient(seed)    d L / d (sigma_t, albedo, g),  L = sum_p (T_p - I_p)^2 / sum_p I_p^2
# The sums are over the object's pixels, T is the image and I the target.


@dataclasses.dataclass
class Target:
    image: np.ndarray      # I
    on_object: np.ndarray  # which pixels count

    @property
    def box(self):
        """Smallest one with all pixels that count: rows and columns, as slices."""
        rows, columns = np.nonzero(self.on_object)
        return (slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1))

    @property
    def energy(self):
        return float((self.image[self.on_object] ** 2).sum())


class Worker:
    """An itn-worker of our own."""

    def __init__(self, binary, threads):
        self.process = subprocess.Popen(
            [binary.resolve(), "--listen", "127.0.0.1:0", "--threads", str(threads),
             "--log-level", "warning"], stdout=subprocess.PIPE, text=True)
        address = self.process.stdout.readline().strip()
        if not address:
            sys.exit(f"{binary} did not start")
        self.service = render_pb2_grpc.RenderServiceStub(grpc.insecure_channel(
            address, options=[("grpc.max_receive_message_length", -1)]))

    def render(self, scene, **request):
        request = render_pb2.RenderGradRequest(scene_digest=hashlib.sha256(scene).digest(),
                                               **request)
        try:
            return self.service.RenderGrad(request)
        except grpc.RpcError as error:
            if error.code() != grpc.StatusCode.FAILED_PRECONDITION:
                raise
        request.scene = scene
        return self.service.RenderGrad(request)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait()


def worker_can(field):
    """Whether the contract has this field of RenderGradRequest."""
    return field in render_pb2.RenderGradRequest.DESCRIPTOR.fields_by_name


class Itn:
    DERIVATIVES = [render_pb2.SIGMA_T, render_pb2.ALBEDO, render_pb2.G]

    def __init__(self, worker, scene):
        self.worker = worker
        self.scene = self.describe(scene)
        self.material = scene.material
        self.target = self.render_target()

    @staticmethod
    def describe(scene):
        pb = scene_pb2.Scene()
        pb.object.mesh.triangles.positions = scene.vertices.tobytes()
        pb.object.mesh.triangles.indices = scene.triangles.tobytes()
        if ARGUMENTS.boundary == "rough":
            pb.object.rough_dielectric.index, pb.object.rough_dielectric.roughness = INDEX, ROUGHNESS
            pb.object.rough_dielectric.single_scattering = True  # as Mitsuba's
        elif ARGUMENTS.boundary == "smooth":
            pb.object.dielectric.index = INDEX
        surface = pb.surfaces.add(reflectance=REFLECTANCE)
        surface.rectangle.half_u.x, surface.rectangle.half_v.z = GROUND_HALF_SIZE, -GROUND_HALF_SIZE
        pixels = pb.lights.add().environment_map.pixels
        pixels.height, pixels.width = LIGHT.shape
        pixels.rgb = np.repeat(LIGHT[..., None], 3, axis=2).tobytes()
        for vector, position in zip((pb.camera.origin, pb.camera.target), camera(scene)):
            vector.x, vector.y, vector.z = position
        pb.camera.fov_degrees = FIELD_OF_VIEW
        pb.film.width = pb.film.height = ARGUMENTS.size
        return pb.SerializeToString(deterministic=True)

    def render_target(self):
        """The image of a somewhat different material."""
        sigma_t, albedo, g = self.material
        reply = self.render(TARGET_SEED, TARGET_SPP,
                            (1.2 * sigma_t, albedo - .03, min(g + .1, .9)))
        return Target(itn_client.image(reply, reply.estimates[0].radiance),
                      itn_client.image(reply, reply.mask) >= ON_OBJECT)

    def render(self, seed, spp=None, material=None, **request):
        if worker_can("pixels"):
            request["pixels"] = render_pb2.OBJECT_PIXELS
        if worker_can("pilot_spp"):
            request["pilot_spp"] = PILOT_SPP
        material = dict(zip(PARAMETERS, material or self.material))
        return self.worker.render(self.scene, seed=seed, spp=spp or ARGUMENTS.spp,
                                  material=render_pb2.Material(**material), **request)

    def on_object(self, reply, data):
        return itn_client.image(reply, data)[self.target.on_object].astype(float)

    def image(self, seed):
        reply = self.render(seed)
        return (self.on_object(reply, reply.estimates[0].radiance), reply.counters.cpu_seconds)

    def mean_derivative(self, seed):
        reply = self.render(seed, derivatives=self.DERIVATIVES)
        return (np.array([self.on_object(reply, d).mean() for d in reply.estimates[0].derivatives]),
                reply.counters.cpu_seconds)

    def loss_gradient(self, seed):
        if worker_can("loss"):
            loss = render_pb2.LossTarget(
                image=self.target.image.astype("<f4").tobytes(),
                weight=self.target.on_object.astype("<f4").tobytes())
            reply = self.render(seed, derivatives=self.DERIVATIVES, estimates=ESTIMATES, loss=loss)
            return np.array(reply.loss_gradient), reply.counters.cpu_seconds
        reply = self.render(seed, derivatives=self.DERIVATIVES, estimates=ESTIMATES)
        return self.u_statistic(reply), reply.counters.cpu_seconds

    def u_statistic(self, reply):
        """The gradient from products of independent estimates only: server/render/weighted_image_loss.h."""
        difference = np.array([self.on_object(reply, e.radiance) for e in reply.estimates])
        difference -= self.target.image[self.target.on_object]
        derivative = np.array([[self.on_object(reply, d) for d in e.derivatives]
                               for e in reply.estimates])
        k = len(difference)
        products = (difference.sum(axis=0) * derivative.sum(axis=0)
                    - (difference[:, None] * derivative).sum(axis=0)) / (k * (k - 1))
        return 2 * products.sum(axis=1) / self.target.energy


class Mitsuba:
    # No limit on the length of a path: no bias. Roulette from the 20th scattering on is somewhat
    # better than from the 5th, the default, and much better than none; volpathmis is as good.
    IMAGE = {"type": "volpath", "max_depth": -1, "rr_depth": 20}
    GRADIENT = {"type": "prbvolpath", "max_depth": -1, "rr_depth": 20}

    def __init__(self, scene, target, scale):
        """`scale`: units of length for 1 mm."""
        self.target = target
        self.scale = scale
        with tempfile.TemporaryDirectory() as folder:
            mesh = os.path.join(folder, "object.ply")
            write_ply(scene, mesh)
            self.scene = mi.load_dict(self.describe(scene, mesh))
        self.image_integrator = mi.load_dict(self.IMAGE)
        self.gradient_integrator = mi.load_dict(self.GRADIENT)
        self.parameters = mi.traverse(self.scene)
        self.differentiated = [
            self.parameters[f"object.interior_medium.{name}"]
            for name in ("sigma_t.value.value", "albedo.value.value", "phase_function.g")]
        self.weight = mi.TensorXf(target.on_object[target.box].astype("f4")[..., None])
        self.reference = mi.TensorXf(target.image[target.box][..., None])

    def describe(self, scene, mesh):
        sigma_t, albedo, g = map(float, scene.material)
        transform = mi.ScalarTransform4f
        # The object's centre is the origin: see offset_of_ray_starts().
        place = transform().scale(self.scale).translate([0, -scene.height / 2, 0])
        origin, target = (place @ mi.ScalarPoint3f(point) for point in camera(scene))
        rows, columns = self.target.box
        return {
            "type": "scene",
            "object": {
                "type": "ply", "filename": mesh, "face_normals": True, "to_world": place,
                "bsdf": {"matched": {"type": "null"},
                         "rough": {"type": "roughdielectric", "distribution": "ggx",
                                   "alpha": ROUGHNESS, "int_ior": INDEX, "ext_ior": 1.},
                         "smooth": {"type": "dielectric", "int_ior": INDEX, "ext_ior": 1.},
                         }[ARGUMENTS.boundary],
                "interior": {"type": "homogeneous", "sigma_t": sigma_t / self.scale,
                             "albedo": albedo, "has_spectral_extinction": False,
                             "phase": {"type": "hg", "g": g}}},
            "ground": {
                "type": "rectangle",
                "to_world": place @ transform().rotate([1, 0, 0], -90).scale(GROUND_HALF_SIZE),
                "bsdf": {"type": "diffuse", "reflectance": REFLECTANCE}},
            "light": {"type": "envmap", "bitmap": mi.Bitmap(
                np.repeat(with_rows_at_edges(LIGHT)[..., None], 3, axis=2))},
            "camera": {
                "type": "perspective", "fov": FIELD_OF_VIEW, "fov_axis": "x",
                "near_clip": self.scale, "far_clip": 100. * self.scale,
                "to_world": transform().look_at(origin, target, [0, 1, 0]),
                "sampler": {"type": "independent", "sample_count": ARGUMENTS.spp},
                "film": {"type": "hdrfilm", "width": ARGUMENTS.size, "height": ARGUMENTS.size,
                         "crop_offset_x": int(columns.start), "crop_offset_y": int(rows.start),
                         "crop_width": int(columns.stop - columns.start),
                         "crop_height": int(rows.stop - rows.start),
                         "rfilter": {"type": "box"}, "pixel_format": "luminance",
                         "component_format": "float32"}}}

    def image(self, seed):
        start = time.process_time()
        image = np.array(mi.render(self.scene, integrator=self.image_integrator, seed=seed))
        seconds = time.process_time() - start
        return image[..., 0][self.target.on_object[self.target.box]].astype(float), seconds

    def mean_derivative(self, seed):
        pixels = float(self.target.on_object.sum())
        return self.gradient(seed, lambda image: dr.sum(image * self.weight) / pixels)

    def loss_gradient(self, seed):
        return self.gradient(seed, lambda image: dr.sum(
            dr.square((image - self.reference) * self.weight)) / self.target.energy)

    def gradient(self, seed, loss):
        """Path replay backpropagation. Image and adjoint have different seeds: no bias."""
        start = time.process_time()
        for parameter in self.differentiated:
            dr.enable_grad(parameter)
            dr.set_grad(parameter, 0)
        image = mi.render(self.scene, self.parameters, integrator=self.gradient_integrator,
                          seed=2 * seed, seed_grad=2 * seed + 1)
        dr.backward(loss(image))
        values = np.array([dr.grad(parameter)[0] for parameter in self.differentiated], float)
        seconds = time.process_time() - start
        return values / [self.scale, 1, 1], seconds


def write_ply(scene, path):
    mesh = mi.Mesh("object", len(scene.vertices), len(scene.triangles))
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = mi.Float(scene.vertices.ravel())
    parameters["faces"] = mi.UInt32(scene.triangles.ravel())
    parameters.update()
    mesh.write_ply(path)


# Mitsuba starts the ray that leaves a surface point p off that surface by
#
#   epsilon (1 + max_i |p_i|),  epsilon = 1500 * 2^-24, in units of length,
#
# on either side: light that enters the medium skips a layer of that thickness, which at sigma_t =
# 100 / mm and a unit of 1 mm costs 0.7 % of the radiance. In mm the offset is
#
#   epsilon (1 / scale + max_i |p_i|),
#
# so that FINE costs 0.2 %; and its effect being linear, the small rest is taken off by
# extrapolating from COARSE, whose offset is larger, to none.
FINE = 1000.
COARSE = 0.25


def offset_of_ray_starts(scene, scale):
    """In mm and multiples of epsilon, averaged over the vertices."""
    p = scene.vertices - [0, scene.height / 2, 0]
    return 1 / scale + np.abs(p).max(axis=1).mean()


# Measuring and comparing.


@dataclasses.dataclass
class Measurement:
    values: np.ndarray  # repetitions x quantities
    cpu_seconds: float  # of one repetition

    @property
    def mean(self):
        return self.values.mean(axis=0)

    @property
    def variance(self):
        return self.values.var(axis=0, ddof=1)


QUANTITIES = ("image", "mean_derivative", "loss_gradient")


def measure(itn, fine, coarse):
    """Runs everything in turns. Measurements by renderer ("itn", "fine", "coarse") and quantity."""
    n = ARGUMENTS.repetitions
    renderers = {"itn": itn, "fine": fine, "coarse": coarse}
    # What is only compared needs fewer, what the extrapolation multiplies by some 0.1 fewer still.
    plan = {(name, quantity): max(3, n // 4 if name == "coarse" else
                                  n // 2 if quantity == "mean_derivative" else n)
            for name in renderers for quantity in QUANTITIES}
    runs = {key: [] for key in plan}
    seeds = itertools.count()
    for repetition in range(n + 1):  # one more, which warms up: scenes are built, kernels compiled
        for (name, quantity), repetitions in plan.items():
            if repetition <= repetitions:
                run = getattr(renderers[name], quantity)(next(seeds))
                runs[name, quantity].append(run)
    return {key: Measurement(np.array([values for values, _ in kept]),
                             statistics.mean(seconds for _, seconds in kept))
            for key, (_, *kept) in runs.items()}


def tiles(target):
    """Averages over TILE x TILE squares, those at least a quarter full, as a matrix on the pixels;
    and the squares' names.

    A tile's mean is nearly normal, as a pixel is not, and shows smaller differences."""
    corners = np.argwhere(target.on_object) // TILE * TILE
    tile, index, count = np.unique(corners, axis=0, return_inverse=True, return_counts=True)
    full = count >= TILE ** 2 / 4
    members = index == np.arange(len(tile))[:, None]
    return ((members / count[:, None])[full],
            [f"tile at row {row}, column {column}" for row, column in tile[full]])


def z_scores(scene, target, measurements):
    """All comparisons of the scene, by name."""
    fine, coarse = (offset_of_ray_starts(scene, scale) for scale in (FINE, COARSE))
    weight = fine / (coarse - fine)

    def z(quantity, functional=lambda values: values):
        of = {name: functional(measurements[name, quantity].values)
              for name in ("itn", "fine", "coarse")}
        return z_of_sum([(1, of["itn"]), (-1 - weight, of["fine"]), (weight, of["coarse"])])

    averages, names = tiles(target)
    of_tiles = z("image", lambda values: values @ averages.T)
    scores = {"mean radiance": float(z("image", lambda values: values.mean(axis=1)))}
    scores |= dict(zip(names, of_tiles.tolist()))
    # Many small differences: their squares add up to chi-square; to z after Wilson, Hilferty 1931.
    spread = 2 / (9 * len(of_tiles))
    scores["spread of the tiles"] = float(
        (np.cbrt((of_tiles ** 2).mean()) - (1 - spread)) / math.sqrt(spread))
    for quantity, name in (("mean_derivative", "d mean radiance"), ("loss_gradient", "d loss")):
        scores |= {f"{name} / d {p}": float(score) for p, score in zip(PARAMETERS, z(quantity))}
    return scores


def efficiency(measurements, name):
    """Errors and costs of one renderer."""
    image, gradient = measurements[name, "image"], measurements[name, "loss_gradient"]
    relative_variance = image.variance.mean() / image.mean.mean() ** 2
    return {
        "pixel_relative_sd": math.sqrt(relative_variance),
        "image_cpu_seconds": image.cpu_seconds,
        "loss_gradient": dict(zip(PARAMETERS, gradient.mean)),
        "loss_gradient_sd": dict(zip(PARAMETERS, np.sqrt(gradient.variance))),
        "gradient_cpu_seconds": gradient.cpu_seconds,
        "variance_x_cpu": {"image": relative_variance * image.cpu_seconds,
                           **dict(zip(PARAMETERS, gradient.variance * gradient.cpu_seconds))},
    }


def compare(worker, scene):
    itn = Itn(worker, scene)
    fine, coarse = (Mitsuba(scene, itn.target, scale) for scale in (FINE, COARSE))
    measurements = measure(itn, fine, coarse)
    ours, theirs = efficiency(measurements, "itn"), efficiency(measurements, "fine")
    return {
        "itn": ours, "mitsuba": theirs,
        "ratio": {k: theirs["variance_x_cpu"][k] / v for k, v in ours["variance_x_cpu"].items()},
        "z": z_scores(scene, itn.target, measurements),
    }


def judge(scenes):
    """Whether any comparison is beyond what chance explains: Sidak's correction."""
    scores = {f"{scene}: {what}": z for scene, result in scenes.items()
              for what, z in result["z"].items()}
    limit = largest_by_chance(len(scores), FAMILY_WISE)
    worst = max(scores, key=lambda name: abs(scores[name]))
    return {"comparisons": len(scores), "limit": limit, "worst": worst, "worst_z": scores[worst],
            "beyond": {name: z for name, z in scores.items() if not abs(z) < limit}}


def geometric_mean(values):
    return math.exp(statistics.mean(map(math.log, values)))


def print_table(result):
    print(f"variance x CPU time, Mitsuba / itn; boundary: {ARGUMENTS.boundary}; {ARGUMENTS.size} x {ARGUMENTS.size}, "
          f"{ARGUMENTS.spp} spp, {ARGUMENTS.threads} threads; light: {result['light']}")
    print(f"{'':22}{'pixel sd / mean':>18}{'CPU s, image':>17}{'CPU s, gradient':>17}"
          f"{'variance x CPU time, Mitsuba / itn':>38}")
    print(f"{'':22}{'Mitsuba':>10}{'itn':>8}{'Mitsuba':>9}{'itn':>8}{'Mitsuba':>9}{'itn':>8}"
          f"{'image':>11}{'d sigma_t':>10}{'d albedo':>9}{'d g':>8}")
    for name, scene in result["scenes"].items():
        ours, theirs = scene["itn"], scene["mitsuba"]
        print(f"{name:22}{theirs['pixel_relative_sd']:10.3f}{ours['pixel_relative_sd']:8.3f}"
              f"{theirs['image_cpu_seconds']:9.2f}{ours['image_cpu_seconds']:8.2f}"
              f"{theirs['gradient_cpu_seconds']:9.2f}{ours['gradient_cpu_seconds']:8.2f}"
              + ratios(scene["ratio"]))
    print(f"{'geometric mean':73}" + ratios(result["geometric_mean"]))
    # The variance of a variance of n normal values is 2 / (n - 1), relatively; a ratio has two.
    error = math.sqrt(4 / (ARGUMENTS.repetitions - 1))
    print(f"ratios of the gradient are known to {100 * error:.0f} %, their geometric means to "
          f"{100 * error / math.sqrt(len(result['scenes'])):.0f} % "
          f"({ARGUMENTS.repetitions} repetitions)")
    agreement = result["agreement"]
    print(f"agreement: worst |z| {abs(agreement['worst_z']):.2f} ({agreement['worst']}) of "
          f"{agreement['comparisons']} comparisons; chance alone exceeds {agreement['limit']:.2f} "
          f"once in {1 / FAMILY_WISE:.0f} runs")


def ratios(ratio):
    return (f"{ratio['image']:10.2f}x{ratio['sigma_t']:9.2f}x{ratio['albedo']:8.2f}x"
            f"{ratio['g']:7.2f}x")


def main():
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # stops the worker, too
    dr.set_thread_count(ARGUMENTS.threads)
    scenes = {}
    with Worker(ARGUMENTS.worker_binary, ARGUMENTS.threads) as worker:
        for scene in all_scenes():
            print(f"{scene.name} ...", file=sys.stderr)
            scenes[scene.name] = compare(worker, scene)
    if not scenes:
        print(f"--scenes: none matches {ARGUMENTS.scenes.pattern}", file=sys.stderr)
        sys.exit(2)
    result = {
        "light": f"the same environment map, {LIGHT.shape[1]} x {LIGHT.shape[0]}",
        "mitsuba": mi.__version__,
        "spp": ARGUMENTS.spp, "size": ARGUMENTS.size, "threads": ARGUMENTS.threads,
        "repetitions": ARGUMENTS.repetitions,
        "scenes": scenes,
        "geometric_mean": {what: geometric_mean([s["ratio"][what] for s in scenes.values()])
                           for what in ("image", *PARAMETERS)},
        "agreement": judge(scenes),
    }
    if ARGUMENTS.json:
        print(json.dumps(result, indent=2))
    else:
        print_table(result)
    if result["agreement"]["beyond"]:
        print("DISAGREEMENT between itn and Mitsuba:", file=sys.stderr)
        for name, z in result["agreement"]["beyond"].items():
            print(f"  {name}: z = {z:.2f}", file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
