#!/usr/bin/python3
"""Makes the pictures of the pages from renders, as PNG or JPEG (Debian: python3-openimageio, python3-numpy).

  picture.py colour IMAGE.exr OUT                          its channels R, G and B, white where few of the object are brighter
  picture.py derivatives IMAGE.exr OUT                     its derivatives of Y beside one another, half the size
  picture.py refinement TARGET.exr A.exr B.exr ... OUT     renders beside their target, and the difference
  picture.py scenes SCENES.png FIRST LAST OUT              of an experiment's report: the truth and five networks of these images,
                                                           counted from 0, a third of the size
"""
import sys

import numpy as np
import OpenImageIO as oiio


def layers(path):
    image = oiio.ImageInput.open(path)
    if image is None:
        sys.exit(f"picture.py: cannot read {path}: {oiio.geterror()}")
    names, spec = image.spec().channelnames, image.spec()
    pixels = image.read_image(oiio.FLOAT)
    return {name: pixels[:, :, i] for i, name in enumerate(names)}, spec


def srgb(linear):
    x = np.clip(linear, 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def diverging(x):
    """White at 0, red above, blue below; full colour at -1 and 1."""
    fade = 1 - np.clip(np.abs(x), 0, 1)
    up, down = np.stack([np.ones_like(x), fade, fade], -1), np.stack([fade, fade, np.ones_like(x)], -1)
    return np.where((x > 0)[..., None], up, down)


def write(path, rgb):
    pixels = (np.clip(rgb, 0, 1) * 255 + 0.5).astype(np.uint8)
    out = oiio.ImageOutput.create(path)
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, oiio.UINT8)
    spec.attribute("Compression", "jpeg:92")  # if it is one
    out.open(path, spec)
    out.write_image(pixels)
    out.close()


def half(image):
    """Averaged down by two."""
    return (image[::2, ::2] + image[1::2, ::2] + image[::2, 1::2] + image[1::2, 1::2]) / 4


def colour(path, out):
    image, _ = layers(path)
    rgb = np.stack([image[channel] for channel in "RGB"], -1)
    write(out, srgb(rgb / np.percentile(rgb[image["mask.Y"] > 0.5], 99.5)))


def derivatives(path, out):
    image, spec = layers(path)
    on = image["mask.Y"] > 0.5
    mean = image["Y"][on].mean()
    sigma_t, albedo = (spec.get_float_attribute(f"itn.{name}") for name in ("sigma_t", "albedo"))
    panels = []
    for name, factor in (("sigma_t", sigma_t), ("albedo", 1 - albedo), ("g", 1), ("rough_dielectric.roughness", 1)):
        if f"{name}.Y" not in image:
            continue
        step = half(factor * image[f"{name}.Y"] / mean)
        full = np.percentile(np.abs(step[half(on.astype(float)) > 0.5]), 99)
        print(f"{name}: full colour is {full:.3g} of the mean radiance of the object")
        panels.append(diverging(step / full))
    write(out, np.concatenate(panels, 1))


def refinement(target, *renders_and_out):
    *renders, out = renders_and_out
    images = [layers(p)[0]["Y"] for p in (target, *renders)]
    white = np.percentile(images[0], 99)
    panels = [np.repeat(srgb(y / white)[..., None], 3, -1) for y in images]
    panels.append(diverging(8 * (images[-1] - images[0]) / white))
    write(out, np.concatenate(panels, 1))


def scenes(path, first, last, out):
    image = oiio.ImageInput.open(path).read_image(oiio.FLOAT)[:, :, :3]
    panel, gap, columns = 256, 8, 6
    top, bottom = (2 * (panel + gap) * number for number in (int(first), int(last) + 1))
    shown = image[top:bottom, : columns * (panel + gap)]
    height, width = (3 * (size // 3) for size in shown.shape[:2])
    write(out, shown[:height, :width].reshape(height // 3, 3, width // 3, 3, 3).mean((1, 3)))


COMMANDS = {"colour": colour, "derivatives": derivatives, "refinement": refinement, "scenes": scenes}
if len(sys.argv) < 4 or sys.argv[1] not in COMMANDS:
    sys.exit(__doc__)
COMMANDS[sys.argv[1]](*sys.argv[2:])
