#!/usr/bin/env python3
"""Photographs of known materials, made by rendering, and what itn fit says of them.

Renders an object in a random pose by another seed, makes an 8-bit sRGB JPEG of quality 90 of it with
the noise of a sensor, fits it with what a user would know wrongly (focal length, mask, place of the
flash, index, a coarser mesh, a shape that is .2 % of its size off), and prints the errors, and how
many truths lie in the 95 % intervals.

  fit_bench.py --itn build/release/bin/itn --out /tmp/fit --cases 12 --setup card|plain|panorama

card: a flash in a dark room, and a gray card; plain: the same without one; panorama: a room whose panorama is
given, not its turn, and a card that lies beside the object. --lie: how often is it told that an answer is wrong?
--colour: of red, green and blue together; --shape: another shape than the case's, and its sides.
Intervals count where they hold, in what is no misfit and not unfinished. Cases that are in --out are
not fitted again. Needs python3-numpy and python3-openimageio (Debian).
"""
import argparse
import json
import math
import pathlib
import random
import re
import subprocess

import numpy as np
import OpenImageIO as oiio

SHAPES = ["sphere", "mug", "figure", "knot", "random:3", "random:8"]
# Reduced scattering and absorption of materials of Jensen et al. 2001 (green), 1/mm, and others.
MATERIALS = [(2.62, 0.0041), (0.70, 0.0012), (1.51, 0.031), (0.88, 0.095), (0.4, 0.02), (3.0, 0.1), (1.0, 0.3), (6.0, 0.05)]
DISTURBANCES = ["focal", "mask", "flash", "index", "mesh", "shape"]
# What makes any answer wrong, which is to be told.
LIES = ["size", "light", "stretch", "two", "curve", "opaque", "waves"]
# Of red, green and blue: reduced scattering and absorption over those of a case's material.
COLOURS = [(0.85, 0.4), (1, 1), (1.2, 2.5)]
# The sides of built-in shapes whose longest side is 1 mm.
SIDES = {"cube": (1, 1, 1), "cylinder": (0.5, 1, 0.5)}
SIDE = 512  # pixels of the photograph
FOV = 20.0  # degrees
SIZE = 40.0  # mm
DOWN = 35.0  # degrees below the horizon that the camera looks in a room


def run(*command):
    return subprocess.run([str(c) for c in command], check=True, capture_output=True, text=True).stdout


def read(path):
    image = oiio.ImageInput.open(str(path))
    pixels, names = image.read_image(format="float"), list(image.spec().channelnames)
    image.close()
    return {name: pixels[..., i] for i, name in enumerate(names)}


def channels_of(render):
    return "RGB" if "R" in render else "Y"


def write(path, pixels, attributes=()):
    pixels = np.ascontiguousarray(pixels if pixels.ndim == 3 else pixels[..., None])
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], "uint8")
    for name, value in attributes:
        spec.attribute(name, value)
    out = oiio.ImageOutput.create(str(path))
    out.open(str(path), spec)
    out.write_image(pixels)
    out.close()


def rotation(rng):
    while True:
        q = np.array([rng.gauss(0, 1) for _ in range(4)])
        if np.linalg.norm(q) > 0.1:
            q /= np.linalg.norm(q)
            angle = 2 * math.acos(max(-1, min(1, q[0])))
            return q[1:] / max(1e-9, np.linalg.norm(q[1:])), math.degrees(angle)


def shape_of(name, folder, itn):
    """What the scene has of it, and what `--shape` takes."""
    if not name.startswith("random:"):
        name = name.split(":")[0]
        return f'builtin: "{name}"', name
    number = int(name[7:])
    made = sorted((folder / "shapes").glob("*.ply"))
    if not made:
        run(itn, "shapes", "--random-shapes", 12, "--shape-seed", 5, "-o", folder / "shapes")
        made = sorted((folder / "shapes").glob("*.ply"))
    return f'path: "{made[number].resolve()}"', str(made[number].resolve())


def read_mesh(path):
    """Vertices and triangles of a PLY file that itn wrote."""
    header, _, data = path.read_bytes().partition(b"end_header\n")
    vertices, faces = (int(re.search(rb"element %s (\d+)" % kind, header)[1]) for kind in (b"vertex", b"face"))
    triangles = np.frombuffer(data, [("corners", "u1"), ("indices", "<i4", 3)], faces, 12 * vertices)["indices"]
    return np.frombuffer(data, "<f4", 3 * vertices).reshape(vertices, 3).astype(float), triangles


def write_mesh(path, vertices, triangles):
    faces = np.zeros(len(triangles), [("corners", "u1"), ("indices", "<i4", 3)])
    faces["corners"], faces["indices"] = 3, triangles
    header = (f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\nproperty float y\n"
              f"property float z\nelement face {len(faces)}\nproperty list uchar uint vertex_indices\nend_header\n")
    path.write_bytes(header.encode() + vertices.astype("<f4").tobytes() + faces.tobytes())


def directions(v):
    return v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-12)


def finer(vertices, triangles):
    """Four triangles for each of a closed mesh, whose smooth parts bulge (Boubekeur and Alexa, "Phong tessellation", 2008)."""
    count = len(vertices)
    corners = vertices[triangles]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], flat)
    normals = directions(normals)
    # A vertex whose triangles lean more than 30 degrees is on an edge of the object, which stays.
    least = np.ones(count)
    for corner in range(3):
        np.minimum.at(least, triangles[:, corner], (directions(flat) * normals[triangles[:, corner]]).sum(1))
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, edge = np.unique(sides, axis=0, return_inverse=True)
    middle = vertices[edges].mean(1)
    on_planes = [middle - ((middle - vertices[end]) * normals[end]).sum(1, keepdims=True) * normals[end] for end in edges.T]
    smooth = (least[edges].min(1) > math.cos(math.radians(30)))[:, None]
    between = middle + np.where(smooth, 0.75 * (sum(on_planes) / 2 - middle), 0)
    a, b, c = triangles.T
    ab, bc, ca = count + edge.reshape(-1, 3).T
    return np.concatenate([vertices, between]), np.concatenate(
        [np.stack(corners, axis=1) for corners in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])


def uneven(vertices, shortest, longest, rng):
    """Moved along each axis by .2 % of the size (RMS), in random waves of such lengths in sizes, but not as a whole."""
    def field():
        waves = rng.normal(size=(100, 3))
        waves *= (2 * np.pi / rng.uniform(shortest, longest, 100) / np.linalg.norm(waves, axis=1))[:, None]
        return np.cos(vertices @ waves.T + rng.uniform(0, 2 * np.pi, 100)).sum(1) / math.sqrt(50)
    moved = 0.002 * np.stack([field() for _ in range(3)], axis=1)
    # Shifts, turns and the size are what the pose and --object-size say.
    arm = vertices - vertices.mean(0)
    whole = [np.broadcast_to(axis, arm.shape) for axis in np.eye(3)] + [np.cross(axis, arm) for axis in np.eye(3)] + [arm]
    whole = np.stack([way.reshape(-1) for way in whole], axis=1)
    moved = moved.reshape(-1)
    return vertices + (moved - whole @ np.linalg.lstsq(whole, moved, rcond=None)[0]).reshape(-1, 3)


def read_normalized(path):
    """Vertices and triangles of a PLY file, brought to the origin and to a longest side of 1."""
    vertices, triangles = read_mesh(path)
    least, most = vertices.min(0), vertices.max(0)
    origin = np.array([(least[0] + most[0]) / 2, least[1], (least[2] + most[2]) / 2])
    return (vertices - origin) / (most - least).max(), triangles


def mesh_of_the_photograph(ideal, folder, wrong, number):
    """What the scene has of a shape whose mesh, for the fit, is this one."""
    vertices, triangles = read_normalized(ideal)
    if wrong["mesh"]:
        vertices, triangles = finer(vertices, triangles)
    for name, shortest, longest in (("shape", 0.25, 1), ("waves", 0.1, 0.25)):
        if wrong[name] and not (name == "shape" and wrong["waves"]):
            vertices = uneven(vertices, shortest, longest, np.random.default_rng(number))
    write_mesh(folder / "truth.ply", vertices, triangles)
    return f'path: "{(folder / "truth.ply").resolve()}"'


def room(rng):
    """A panorama of gray walls, a floor that is darker, a bright ceiling, two windows and a lamp."""
    height, width = 64, 128
    up = 90 - 180 * (np.arange(height) + 0.5) / height
    around = 360 * (np.arange(width) + 0.5) / width
    pixels = np.where(up < -20, 0.25, np.where(up > 45, 0.6, 0.4))[:, None] * np.ones(width)
    middle = rng.uniform(0, 360)
    for at, tall, wide, radiance in ((middle, 25, 25, 12), (middle + rng.uniform(90, 150), 20, 15, 6)):
        turned = np.abs((around - at + 180) % 360 - 180)
        pixels[np.outer(np.abs(up - 20) < tall, turned < wide)] = radiance
    turned = np.abs((around - rng.uniform(0, 360) + 180) % 360 - 180)
    pixels[np.outer(np.abs(up - 70) < 8, turned < 20)] = 30
    return pixels


def write_panorama(path, pixels):
    out = oiio.ImageOutput.create(str(path))
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 1, "float")
    spec.channelnames = ("Y",)
    out.open(str(path), spec)
    out.write_image(np.ascontiguousarray(pixels[..., None], dtype="float32"))
    out.close()


def looking_down(v, degrees):
    """From the coordinates of a camera that looks so far down to those of the room."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return v[0], c * v[1] + s * v[2], -s * v[1] + c * v[2]


def by_flash(setup):
    return setup != "panorama"


def vector(v):
    return f"{{ x: {v[0]} y: {v[1]} z: {v[2]} }}"


def pixel_of(point):
    """Of a point before the camera."""
    focal = SIDE / 2 / math.tan(math.radians(FOV / 2))
    return SIDE / 2 + focal * point[0] / -point[2], SIDE / 2 - focal * point[1] / -point[2]


def card_in(setup):
    """A gray card before the camera: its middle, and half its sides. As far as the object by flash; flat in a room."""
    if setup == "card":
        return (-29, 29, -257), (5, 0, 0), (0, 5, 0)
    back = looking_down((0, 0, -1), -DOWN)
    return (-30, 26, -262), (7, 0, 0), tuple(8 * x for x in back)


def scene(mesh, scale, rng, setup, roughness, index, flash, turn):
    axis, angle = rotation(rng)
    down = 0 if by_flash(setup) else DOWN
    light = f"lights {{ point {{ position {{ x: {flash[0]} y: {flash[1]} z: {flash[2]} }} intensity: 0.2 }} }}"
    card = ""
    if setup in ("card", "panorama"):
        center, u, v = (looking_down(p, down) for p in card_in(setup))
        card = (f"surfaces {{ rectangle {{ center {vector(center)} half_u {vector(u)} half_v {vector(v)} }} "
                "reflectance: 0.18 }")
    if not by_flash(setup):
        # The middle of the panorama lies where the camera looks, at turn 0.
        light = f'lights {{ environment_map {{ path: "room.exr" rotate_y_degrees: {180 + turn} }} }}'
    to_place = looking_down((rng.uniform(-3, 8), rng.uniform(-8, 3), -260), down)
    tilt = f"transforms {{ rotate {{ axis {{ x: 1 }} angle_degrees: {-down} }} }}" if down else ""
    # The mesh stands on its origin: its middle is brought to where the camera looks.
    return f"""object {{
  mesh {{ {mesh}
    transforms {{ scale {vector(scale)} }}
    transforms {{ translate {{ y: {-scale[1] / 2.5} }} }}
    transforms {{ rotate {{ axis {vector(axis)} angle_degrees: {angle} }} }}
    {tilt}
    transforms {{ translate {vector(to_place)} }} }}
  rough_dielectric {{ index: {index} roughness: {roughness} }}
  smooth_angle_degrees: 30
}}
{card}
{light}
camera {{ origin {{}} target {vector(looking_down((0, 0, -1), down))} up {vector(looking_down((0, 1, 0), down))} fov_degrees: {FOV} }}
film {{ width: {SIDE} height: {SIDE} }}
"""


def size_of(shape):
    """By what the shape of 1 mm is scaled, and what `--object-size` says."""
    if ":" not in shape or shape.startswith("random:"):
        return [SIZE] * 3, [SIZE]
    name, sides = shape.split(":")
    sides = [float(side) for side in sides.split(",")]
    return [side / of_one for side, of_one in zip(sides, SIDES[name])], sides


def blurred(image, mask):
    """Means over squares of 51 pixels of the object."""
    def sums(x):
        for axis in (0, 1):
            to_here = np.cumsum(np.pad(x, [(26, 25) if a == axis else (0, 0) for a in (0, 1)]), axis)
            last = to_here.shape[axis]
            x = to_here.take(range(51, last), axis) - to_here.take(range(last - 51), axis)
        return x
    return sums(image * mask) / np.maximum(sums(mask), 1e-6)


def material_of(number):
    """Reduced scattering and absorption."""
    return MATERIALS[(number // len(SHAPES) + number) % len(MATERIALS)]


def random_of(number, seed):
    """What a case is drawn by. Its first number is g."""
    rng = random.Random(1000 * seed + number)
    return rng, rng.uniform(0, 0.8)


def brightness(image, mask, setup):
    """What the radiance is multiplied with: the object is bright, and so a card is not clipped."""
    scale = 0.8 / np.percentile(image[mask > 0.5], 99.5)
    return scale if setup == "plain" else min(scale, 0.9 / np.percentile(image, 99.9))


def sensor_variance(x):
    return 2e-4 * np.maximum(x, 0) + 1e-6


def photograph(render, folder, rng, setup, wrong):
    """As a camera has it: sensor noise, clipped, encoded; and a mask that may be a pixel off."""
    noise = np.random.default_rng(rng.randrange(1 << 30))
    mask = render["mask.Y"]
    image = np.stack([render[channel] for channel in channels_of(render)], axis=-1)

    if wrong["curve"]:  # what is dark is lifted, as phones do
        lifted = np.maximum(blurred(image.mean(axis=-1), mask), 1e-9) ** -0.3
        image = np.where(mask > 0.5, lifted, 1)[..., None] * image
    x = image * brightness(image, mask, setup)
    x = np.clip(x + noise.normal(size=x.shape) * np.sqrt(sensor_variance(x)), 0, 1)
    x = np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055)
    write(folder / "photo.jpg", (255 * x + 0.5).astype("uint8"), [("Compression", "jpeg:90")])
    off = wrong["mask"] * rng.choice([-1, 0, 1])
    if off != 0:
        shifted = [np.roll(mask, (dy, dx), (0, 1)) for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0))]
        mask = (np.maximum if off > 0 else np.minimum).reduce([mask] + shifted)
    write(folder / "mask.png", (255 * np.clip(mask, 0, 1) + 0.5).astype("uint8"))


def diffuse_albedo(sigma_s, sigma_a):
    """Of a half-space, by van de Hulst's fit, as itn has it."""
    s = math.sqrt(sigma_a / (sigma_a + sigma_s))
    return (1 - s) * (1 - 0.139 * s) / (1 + 1.17 * s)


# Turns of shapes into themselves: axis, and degrees. A ball has all.
TURNS = {
    "random:3": [((0, 1, 0), 60 * sixth, (0, 0, 1), 0) for sixth in range(6)],
    "knot": [((0, 1, 0), half, (0, 0, 1), 120 * third) for half in (0, 180) for third in range(3)],
    "cube": [((0, 1, 0), half, (0, 0, 1), other) for half in (0, 180) for other in (0, 180)],
    "cylinder": [((0, 1, 0), 2 * turn, (0, 0, 1), half) for half in (0, 180) for turn in range(180)],
}


def turned(axis, degrees):
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = math.radians(degrees)
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def placed(scene):
    """The object's rotation and the whole of its affine transform, and the view's angle."""
    text = scene.read_text()
    linear, shift, rotation = np.eye(3), np.zeros(3), np.eye(3)
    for kind, body in re.findall(r"transforms\s*{\s*(scale|rotate|translate)\s*({(?:[^{}]|{[^{}]*})*})", text):
        v = np.array([float((re.search(rf"\b{c}: (\S+)", body) or [0, 0])[1]) for c in "xyz"])
        if kind == "translate":
            shift = shift + v
            continue
        degrees = re.search(r"angle_degrees: (\S+)", body)
        by = np.diag(v) if kind == "scale" else turned(v, float(degrees[1])) if degrees else np.eye(3)
        linear, shift = by @ linear, by @ shift
        rotation = by @ rotation if kind == "rotate" else rotation
    return rotation, linear, shift, float(re.search(r"fov_degrees: (\S+)", text)[1])


def pose_error(folder, shape, middle):
    """Degrees, and a part of the distance in focal lengths: from far away those two are one number."""
    rotation, linear, shift, fov = placed(folder / "truth.textproto")
    found_rotation, found_linear, found_shift, found_fov = placed(folder / "fit" / "scene.textproto")
    kind = shape if shape.startswith("random:") else shape.split(":")[0]
    turns = [turned(a, m) @ turned(b, n) for a, m, b, n in TURNS.get(kind, [((0, 1, 0), 0) * 2])]
    trace = max(np.trace(rotation.T @ found_rotation @ turn) for turn in turns)
    degrees = 0 if shape == "sphere" else math.degrees(math.acos(max(-1, min(1, (trace - 1) / 2))))
    ranges = [np.linalg.norm(a @ middle + b) * math.tan(math.radians(f / 2))
              for a, b, f in ((linear, shift, fov), (found_linear, found_shift, found_fov))]
    return degrees, ranges[1] / ranges[0] - 1


def file_of(shape, options):
    mesh = shape_of(shape, options.out, options.itn)[1]
    return pathlib.Path(mesh) if "/" in mesh else options.out / "builtin" / f"{mesh.split(':')[0]}.ply"


def case(number, options):
    """Folder, shape, truths by colour, and what itn fit says."""
    rng, g = random_of(number, options.seed)
    shape = options.shape or SHAPES[number % len(SHAPES)]
    kinds = ["" if options.wrong == DISTURBANCES else "-".join(options.wrong),
             f"lie-{options.lie}" if options.lie else "", "colour" if options.colour else "",
             "reference" if options.reference else "", re.sub("[:,]", "_", options.shape or "")]
    folder = options.out / "-".join([f"{options.setup}{number:03}"] + [kind for kind in kinds if kind])
    result = folder / "result.json"
    sigma_s, sigma_a = material_of(number)
    dense = 100 if options.lie == "opaque" else 1
    truths = [{"sigma_s_reduced": dense * s * sigma_s, "sigma_a": dense * a * sigma_a}
              for s, a in (COLOURS if options.colour else [(1, 1)])]
    told = f"wrong: {','.join(options.wrong)}; lie: {options.lie}; seed: {options.seed}; time limit: {options.time_limit:g} s\n"
    said = folder / "case.txt"
    if result.exists() and (not said.exists() or said.read_text() != told):
        raise SystemExit(f"{folder} has a case of other options than {told.strip()}: choose another --out")
    if not result.exists():
        folder.mkdir(parents=True, exist_ok=True)
        said.write_text(told)
        mesh, fitted = shape_of(shape, options.out, options.itn)
        scale, size = size_of(shape)
        wrong = {name: 1 if name in options.wrong or name == options.lie else 0 for name in DISTURBANCES + LIES}
        index, roughness = 1.45 + wrong["index"] * rng.uniform(-0.05, 0.05), rng.uniform(0.15, 0.4)
        flash = [offset + wrong["flash"] * rng.uniform(-6, 6) for offset in (0, 12, 0)]
        if wrong["light"]:
            flash[0] += 70
        scale[0] *= 1 + 0.05 * wrong["stretch"]
        turn = 0 if by_flash(options.setup) else rng.uniform(-180, 180)
        mesh += " normalize: true"
        has_corners = shape.split(":")[0] in SIDES
        if wrong["waves"] and has_corners:
            raise SystemExit(f"--lie waves moves vertices, and a {shape} has none but its corners")
        if (wrong["mesh"] or wrong["shape"] or wrong["waves"]) and not has_corners:
            mesh = mesh_of_the_photograph(file_of(shape, options), folder, wrong, number)
        (folder / "truth.textproto").write_text(
            scene(mesh, scale, rng, options.setup, roughness, index, flash, turn))
        if not by_flash(options.setup):
            write_panorama(folder / "room.exr", room(random.Random(9000 + number)))
        renders = []
        for thinner in ((1, 0.25) if wrong["two"] else (1,)):
            file = folder / f"truth{'' if thinner == 1 else '_thin'}.exr"
            sigma_t = [t["sigma_a"] + t["sigma_s_reduced"] / (1 - g) for t in truths]
            albedo = [1 - t["sigma_a"] / total for t, total in zip(truths, sigma_t)]
            if not file.exists():
                run(options.itn, "render", folder / "truth.textproto", "-o", file,
                    "--sigma-t", ",".join(str(thinner * total) for total in sigma_t),
                    "--albedo", ",".join(str(one) for one in albedo), "--g", g, "--noise", "5%", "--time", "400s" if options.reference else "40s",
                    "--spp", 4096, "--seed", 77 + number, *(["--tracer", "reference"] if options.reference else []))
            renders.append(read(file))
        if wrong["two"]:  # the left half of the frame is thinner
            for channel in channels_of(renders[0]):
                renders[0][channel][:, : SIDE // 2] = renders[1][channel][:, : SIDE // 2]
        photograph(renders[0], folder, rng, options.setup, wrong)
        focal = 43.2666 / (2 * math.tan(math.radians(FOV / 2))) / math.sqrt(2)
        focal *= 1 + wrong["focal"] * rng.uniform(-0.01, 0.01)
        flags = [] if options.colour else ["--luminance"]
        if options.setup != "plain":
            center, u, v = (np.array(x) for x in card_in(options.setup))
            corners = [pixel_of(center + 0.7 * (x * u + y * v)) for x in (-1, 1) for y in (-1, 1)]
            left, top = (round(max(sorted(c[i] for c in corners)[:2])) for i in (0, 1))
            right, bottom = (round(min(sorted(c[i] for c in corners)[2:])) for i in (0, 1))
            flags += ["--gray-card", f"{left},{top},{right - left},{bottom - top}"]
        if not by_flash(options.setup):
            flags += ["--light", folder / "room.exr", "--camera-down", DOWN]
            if wrong["light"]:
                flags += ["--panorama-turn", turn + 15]
        command = [options.itn, "fit", folder / "photo.jpg", "--shape", fitted, "--object-size",
                   ",".join(str(side * (1 + 0.1 * wrong["size"])) for side in size), "--mask", folder / "mask.png",
                   "--focal-length", focal, "--index", 1.45, "--json", "-o", folder / "fit", "--time-limit",
                   options.time_limit, *flags]
        (folder / "command.txt").write_text(" ".join(str(word) for word in command) + "\n")
        try:
            result.write_text(run(*command))
        except subprocess.CalledProcessError as error:
            result.write_text(json.dumps({"error": error.stderr.strip().splitlines()[-1]}))
    return folder, shape, truths, json.loads(result.read_text())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--itn", required=True, type=pathlib.Path)
    parser.add_argument("--out", required=True, type=pathlib.Path)
    parser.add_argument("--cases", type=int, default=12)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--setup", choices=["card", "plain", "panorama"], default="card")
    parser.add_argument("--lie", choices=LIES, help="what makes any answer wrong: the size by 10 %%, the light by 15 "
                        "degrees, the shape by 5 %% along an axis, another material in the left half, a local tone curve, a "
                        "material that is a hundred times as dense, waves of .2 %% on the surface that lean it by 4 degrees")
    parser.add_argument("--shape", help="of all cases: a built-in one, or cube or cylinder and its sides in mm, as cube:40,12,28")
    parser.add_argument("--colour", action="store_true", help="three materials instead of one")
    parser.add_argument("--wrong", default=",".join(DISTURBANCES), help="what the fit is told wrongly; none: nothing")
    parser.add_argument("--reference", action="store_true", help="render by the reference tracer")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--time-limit", type=float, default=240, help="of a fit, in seconds")
    options = parser.parse_args()
    options.wrong = options.wrong.split(",")
    errors = {"sigma_s_reduced": [], "sigma_a": []}
    deviations = {name: [] for name in errors}  # errors over what the answer says of them
    albedos, right_poses = [], 0
    run(options.itn, "shapes", "-o", options.out / "builtin")
    inside, total, told, unfinished = 0, 0, 0, 0
    for number in range(options.first, options.first + options.cases):
        folder, shape, truths, result = case(number, options)
        if "error" in result:
            print(f"{number:3} {shape:10} refused: {result['error']}", flush=True)
            continue
        pose = result["poses"][0]
        text = f"{number:3} {shape:10} overlap {pose['overlap']:.3f}{' AMBIGUOUS' if pose.get('ambiguous') else ''}"
        degrees, off = pose_error(folder, shape, read_normalized(file_of(shape, options))[0].mean(0))
        right_poses += (degrees <= 1 and abs(off) <= 0.005) or pose.get("ambiguous", False)
        text += f" {degrees:.2f} degrees {100 * off:+.2f} %"
        told += any(found.get("misfit", False) for found in result["results"])
        unfinished += result["results"][0].get("unfinished", False)
        for truth, found in zip(truths, result["results"]):
            text += "".join(f" {word}" for word in ("misfit", "unfinished") if found.get(word))
            values = [found[name]["value"] for name in truth]
            albedos.append(abs(diffuse_albedo(*values) - diffuse_albedo(*truth.values())))
            for name, value in truth.items():
                p = found[name]
                off = math.log(p["value"] / value)
                errors[name].append(abs(off))
                deviations[name].append(abs(p["value"] - value) / p["standard_deviation"])
                holds = p["low_95"] <= value <= p["high_95"]
                if not found.get("misfit") and not found.get("unfinished"):
                    inside += holds
                    total += 1
                text += f"  {name} {p['value']:.4g} of {value:.4g} ({off:+.3f}{'' if holds else ' OUTSIDE'})"
        print(f"{text}  {result['results'][0]['seconds']:.0f} s", flush=True)
    for name, off in errors.items():
        if off:
            print(f"median error of ln {name}: {np.median(off):.3f} of {len(off)}, "
                  f"{np.median(deviations[name]):.2f} standard deviations (.67 of a Gaussian)")
    if albedos:
        print(f"median error of the diffuse albedo: {np.median(albedos):.4f}")
    print(f"poses within 1 degree and .5 %, or told to be ambiguous: {right_poses}")
    print(f"truths in the 95 % intervals: {inside} of {total}; told as misfits: {told}, as unfinished: {unfinished}")


if __name__ == "__main__":
    main()
