#!/usr/bin/python3
"""Checks itn.Scene.save as a scene of Mitsuba 3: renders scenes in itn, and what was written of them in Mitsuba.

    check_mitsuba_scene.py [--scenes REGEX] [--repetitions N] [--spp N] ...

They must agree in every channel of every tile of 8 x 8 pixels and of the whole image, by z-tests with Sidak's
correction. Mitsuba's rays start a little off surfaces, so that dense media are darker there: media here are thin.

Installs Mitsuba from the package index that pip is configured for into a virtual environment (Debian: python3-venv).
itn is taken from build/release/python.

Exit codes: 0 both agree, 1 they do not, or an error, 2 command line, 77 skipped since something is missing.
"""

import argparse
import pathlib
import re
import sys
import tempfile

from renderer_setup import MITSUBA, enter_virtual_environment

ROOT = pathlib.Path(__file__).resolve().parents[2]


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=re.compile, default="", metavar="REGEX", help="those whose names match")
    parser.add_argument("--repetitions", type=int, default=12, metavar="N", help="independent runs (default: 12)")
    parser.add_argument("--spp", type=int, default=128, help="samples per pixel of a run (default: 128)")
    parser.add_argument(
        "--venv",
        type=pathlib.Path,
        metavar="DIR",
        default=ROOT / "build/mitsuba-venv",
        help="virtual environment with Mitsuba; made when absent (default: build/mitsuba-venv)",
    )
    arguments = parser.parse_args()
    if arguments.repetitions < 3:
        parser.error("--repetitions: a variance wants 3 at least")
    return arguments


ARGUMENTS = parse_arguments()
enter_virtual_environment(ARGUMENTS.venv, MITSUBA, "numpy")

import mitsuba as mi  # noqa: E402
import numpy as np  # noqa: E402

sys.path.insert(0, str(ROOT / "build/release/python"))
import itn  # noqa: E402
from tiles import agree, tiles  # noqa: E402

mi.set_variant("scalar_rgb")

# A little air below objects that are not moved away: as much as Scene.save leaves where they stand on the ground.
GAP = 0.01
GROUND = {"rectangle": {"half_u": (20, 0, 0), "half_v": (0, 0, -20)}, "reflectance": 0.5}
CAMERA = {"origin": (1, 3, -7), "target": (0, 0.6, 0), "fov_degrees": 20}
FILM = {"width": 48, "height": 48}
PIXELS = np.random.default_rng(1).uniform(0.05, 0.95, (4, 6, 3)).astype("f4")
SKY = np.random.default_rng(2).uniform(0.1, 1.5, (8, 16, 3)).astype("f4")
SKY[2, 3] = 20


def raised(name, by=(0, GAP, 0), **others):
    return {"mesh": {"builtin": name, "transforms": [*others.pop("turns", []), {"translate": by}]}, **others}


def scene(*, lights, objects=(), surfaces=(GROUND,), camera=CAMERA, film=FILM):
    return {
        "object": objects[0] if objects else raised("cube"),
        "other_objects": list(objects[1:]),
        "surfaces": list(surfaces),
        "lights": lights,
        "camera": camera,
        "film": film,
    }


PATTERN = {"corner": (0.3, 0, 0.2), "edge_u": (0.8, 0, 0.3), "edge_v": (-0.2, 0, 0.6)}
GLOSS = {"index": 1.4, "roughness": 0.3, "single_scattering": True}
SCENES = {
    "standing": (scene(lights=[{"constant": {}}], objects=[raised("cube", (0, 0, 0))]), {}),
    "mirrored, under a lamp": (
        scene(
            lights=[
                {"panel": {"center": (0.6, 0.5, 0), "half_u": (0, 0, 0.6), "half_v": (0, 0.6, 0), "radiance": 2}},
                {"constant": {"radiance": 0.3}},
            ],
            objects=[
                raised("mug", (0, 0, 0), turns=[{"scale": (-1, 1, 1)}], dielectric={"index": 1.3}),
                raised(
                    "cube",
                    (-0.95, 0.2, 0),
                    turns=[{"scale": (0.5, 1, 0.5)}],
                    dielectric={"index": 1.1},
                    material=[{"sigma_t": 2, "albedo": 0.7}],
                ),
            ],
        ),
        {"g": 0.2},
    ),
    "sun and sky": (scene(lights=[{"sun_sky": {"sun_angular_radius_degrees": 10}}]), {"g": 0.3}),
    "real sun": (scene(lights=[{"sun_sky": {"sun_azimuth_degrees": 70, "sky_scale": 0.3}}]), {}),
    "panorama, red": (
        scene(
            lights=[{"environment_map": {"pixels": {"width": 16, "height": 8, "rgb": SKY}, "rotate_y_degrees": 50}}],
            film={**FILM, "channel": "RED"},
        ),
        {"phase": "two_term { g_1: 0.7 g_2: -0.4 weight: 0.8 }"},
    ),
    "two far lights": (
        scene(
            lights=[
                {"constant": {"radiance": 0.3}},
                {"environment_map": {"pixels": {"width": 16, "height": 8, "rgb": SKY}, "scale": 0.5}},
                {"directional": {"direction": (1, 2, -1), "irradiance": 2, "angular_radius_degrees": 4}},
            ],
            film={**FILM, "channel": "RGB"},
        ),
        {},
    ),
    "lamps": (
        scene(
            lights=[
                {"sphere": {"center": (1.2, 2.2, -1), "radius": 0.3, "radiance": 6}},
                {
                    "panel": {
                        "center": (-1.5, 1.6, 0),
                        "half_u": (0, 0.3, 0.1),
                        "half_v": (0.2, 0, 0.4),
                        "radiance": 5,
                    },
                    "color": {"red": 1, "green": 0.6, "blue": 0.2},
                },
                {"panel": {"center": (0, 2.5, 0.5), "half_u": (0.4, 0, 0), "half_v": (0, 0, 0.2), "radiance": 4}},
                {"directional": {"direction": (0.4, 1, -0.7), "irradiance": 0.8}},
                {"point": {"position": (0, 2.5, 1), "intensity": 6e-7}, "color": {"red": 0.1, "blue": 2}},
            ],
            surfaces=[{**GROUND, "reflectance": None, "checkerboard": {"even": 0.7, "odd": 0.2, **PATTERN}}],
            film={"width": 56, "height": 40, "channel": "RGB"},
            camera={**CAMERA, "principal_x": 0.45, "principal_y": 0.6, "crop": {"left": 0.1, "right": 0.8}},
        ),
        {"g": 0.4},
    ),
    "pictures and meshes": (
        scene(
            lights=[{"constant": {}}, {"sun_sky": {"sun_angular_radius_degrees": 5}}],
            surfaces=[
                {
                    **GROUND,
                    "reflectance": None,
                    "image": {"pixels": {"width": 6, "height": 4, "rgb": PIXELS}, "scale": 0.8, **PATTERN},
                },
                {
                    **raised("sphere", (-0.9, 0.2, 0.3)),
                    "smooth_angle_degrees": 40,
                    "color": {"red": 0.8, "green": 0.4, "blue": 0.1},
                },
                {"rectangle": {"center": (1.4, 0.5, 1), "half_u": (0.3, 0, 0.2), "half_v": (0.1, 0.4, 0)}},
            ],
            film={**FILM, "channel": "RGB"},
        ),
        {},
    ),
    "rough": (
        scene(
            lights=[
                {"constant": {"radiance": 0.5}},
                {"sphere": {"center": (1.2, 2.2, -1), "radius": 0.8, "radiance": 3}},
            ],
            objects=[
                raised("sphere", rough_dielectric=GLOSS, smooth_angle_degrees=40),
                raised(
                    "cube",
                    (-1.2, 0.4, -0.3),
                    rough_dielectric={**GLOSS, "index": 1.2},
                    material=[{"sigma_t": 1, "albedo": 0.95}],
                ),
            ],
        ),
        {"g": 0.5},
    ),
    "smooth": (
        scene(
            lights=[
                {"constant": {"radiance": 0.5}},
                {"sphere": {"center": (1.2, 2.2, -1), "radius": 0.8, "radiance": 3}},
            ],
            objects=[
                raised("cube", turns=[{"rotate": {"axis": (0, 1, 0), "angle_degrees": 30}}], dielectric={"index": 1.4})
            ],
        ),
        {},
    ),
    "colour": (scene(lights=[{"constant": {}}]), {"sigma_t": (4, 2, 1), "albedo": (0.95, 0.8, 0.5), "g": 0.6}),
}


def plain(value):
    """Without what is None."""
    if isinstance(value, dict):
        return {name: plain(held) for name, held in value.items() if held is not None}
    return [plain(held) for held in value] if isinstance(value, list) else value


def check(name, described, medium, folder):
    ours_of = itn.scene(plain(described))
    medium = {"sigma_t": 3, "albedo": 0.85, **medium}
    file = folder / "scene.xml"
    ours_of.save(file, **medium)
    theirs_of = mi.load_file(str(file))
    channels = 3 if itn.render(ours_of, **medium, spp=1).image.ndim == 3 else 1
    a, b = [], []
    for seed in range(ARGUMENTS.repetitions):
        a.append(tiles(itn.render(ours_of, **medium, spp=ARGUMENTS.spp, seed=seed).image))
        b.append(tiles(np.array(mi.render(theirs_of, seed=seed, spp=ARGUMENTS.spp))[..., :channels]))
    return agree(name, a, b, channels, rounding=1e-5, alike=1e-4)


def main():
    chosen = {name: what for name, what in SCENES.items() if re.search(ARGUMENTS.scenes, name)}
    with tempfile.TemporaryDirectory() as name:
        if not all([check(scene_name, *what, pathlib.Path(name)) for scene_name, what in chosen.items()]):
            print("DISAGREEMENT between itn and Mitsuba", file=sys.stderr)
            sys.exit(1)


if __name__ == "__main__":
    main()
