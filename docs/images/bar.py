#!/usr/bin/python3
"""Makes a bar of soap with a word pressed into it, as a PLY file (Debian: python3-openimageio, python3-numpy).

  bar.py WORD OUT.ply

Its front faces -z. It is 1 wide, 0.6 high and 0.26 deep.
"""
import sys

import numpy as np
import OpenImageIO as oiio

WIDTH, HEIGHT, DEPTH = 0.5, 0.3, 0.13  # halved
STEPS = 110  # of the grid, from its middle to a side
PIXELS = 800  # of the word's picture, per unit of length
PRESSED = 0.15  # how deep
BLUR = 0.02  # of the word's edges


def word_at(word, x, y):
    """1 in its letters and 0 elsewhere, at places on the front."""
    size = int(2 * WIDTH * PIXELS), int(2 * HEIGHT * PIXELS)
    picture = oiio.ImageBuf(oiio.ImageSpec(*size, 1, oiio.FLOAT))
    oiio.ImageBufAlgo.zero(picture)
    oiio.ImageBufAlgo.render_text(picture, size[0] // 2, size[1] // 2, word, int(0.86 * size[1]),
                                  "DejaVuSans-Bold", (1.0,), alignx="center", aligny="center")
    kernel = oiio.ImageBufAlgo.make_kernel("gaussian", BLUR * PIXELS, BLUR * PIXELS)
    pixels = np.asarray(oiio.ImageBufAlgo.convolve(picture, kernel).get_pixels())[..., 0]
    # From -z, x grows to the left.
    across = np.clip((0.5 - x / (2 * WIDTH)) * size[0] - 0.5, 0, size[0] - 1.001)
    down = np.clip((0.5 - y / (2 * HEIGHT)) * size[1] - 0.5, 0, size[1] - 1.001)
    i, j = down.astype(int), across.astype(int)
    f, g = down - i, across - j
    upper = pixels[i, j] * (1 - g) + pixels[i, j + 1] * g
    lower = pixels[i + 1, j] * (1 - g) + pixels[i + 1, j + 1] * g
    return upper * (1 - f) + lower * f


def bar(word):
    """Vertices and triangles: two sheets that meet in a rim, |x / a|^5 + |y / b|^5 = 1."""
    side = np.linspace(-1, 1, 2 * STEPS + 1)
    side = np.sign(side) * (1 - (1 - np.abs(side)) ** 1.6)  # finer towards the rim
    u, v = np.meshgrid(side, side)
    rim = np.maximum(abs(u), abs(v))  # 1 there
    scale = rim / np.maximum((abs(u) ** 5 + abs(v) ** 5) ** 0.2, 1e-12)
    x, y = WIDTH * u * scale, HEIGHT * v * scale
    back = DEPTH * np.maximum(1 - rim**4, 0) ** 0.25
    front = PRESSED * word_at(word, x, y) - back
    inside = rim < 1
    of_front = np.arange(u.size).reshape(u.shape)
    of_back = of_front.copy()
    of_back[inside] = u.size + np.arange(inside.sum())
    vertices = np.concatenate([np.stack([x, y, front], -1).reshape(-1, 3), np.stack([x, y, back], -1)[inside]])

    # Each square is cut towards the middle, so that no triangle has its three corners on the rim.
    middle_u, middle_v = u[:-1, :-1] + u[1:, 1:], v[:-1, :-1] + v[1:, 1:]
    along = (middle_u * middle_v).ravel() > 0

    def triangles(numbers):
        a, b, c, d = (n.ravel() for n in (numbers[:-1, :-1], numbers[:-1, 1:], numbers[1:, 1:], numbers[1:, :-1]))
        halves = [(a, b, c), (a, c, d)], [(a, b, d), (b, c, d)]
        return np.concatenate(
            [np.stack(half, -1)[chosen] for cut, chosen in zip(halves, (along, ~along)) for half in cut])

    return vertices, np.concatenate([triangles(of_front)[:, ::-1], triangles(of_back)])


def write_ply(path, vertices, triangles):
    faces = np.empty(len(triangles), dtype=[("count", "u1"), ("vertices", "<i4", 3)])
    faces["count"], faces["vertices"] = 3, triangles
    with open(path, "wb") as file:
        file.write(f"""ply
format binary_little_endian 1.0
element vertex {len(vertices)}
property float x
property float y
property float z
element face {len(triangles)}
property list uchar int vertex_indices
end_header
""".encode())
        file.write(vertices.astype("<f4").tobytes() + faces.tobytes())


if len(sys.argv) != 3:
    sys.exit(__doc__)
write_ply(sys.argv[2], *bar(sys.argv[1]))
