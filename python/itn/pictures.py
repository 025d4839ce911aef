"""Pictures to look at. They show themselves in a notebook."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _core
from .errors import writing


class Picture:
    """A picture of (height, width, 3) bytes, encoded by sRGB."""

    def __init__(self, pixels: npt.NDArray[np.uint8]):
        self.pixels = np.ascontiguousarray(pixels, dtype=np.uint8)

    @property
    def png(self) -> bytes:
        """The bytes of a PNG file."""
        return _core.encode_png(self.pixels)

    def enlarged(self, times: int) -> Picture:
        """So many pixels for each, in x and in y."""
        return Picture(self.pixels.repeat(times, axis=0).repeat(times, axis=1))

    def write(self, path: str | os.PathLike[str]) -> None:
        """Writes a PNG file."""
        with writing(path) as temporary, open(temporary, "wb") as file:
            file.write(self.png)

    def _repr_png_(self) -> bytes:
        return self.png


def of_radiance(image: npt.NDArray[Any], white: float) -> Picture:
    """Of radiance, (height, width) or (height, width, 3): `white` and more is white."""
    linear = np.clip(image / white if white > 0 else image, 0, 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    pixels = np.round(255 * encoded).astype(np.uint8).reshape(*image.shape[:2], -1)
    return Picture(np.broadcast_to(pixels, (*image.shape[:2], 3)))


def of_signs(image: npt.NDArray[Any]) -> Picture:
    """Of numbers of both signs: red above 0, blue below, white at 0."""
    gray = image if image.ndim == 2 else image.mean(axis=2)
    most = np.quantile(np.abs(gray), 0.995)
    t = np.clip(gray / most if most > 0 else gray, -1, 1)
    red, blue = np.minimum(1, 1 + t), np.minimum(1, 1 - t)
    return Picture(np.round(255 * np.stack([red, 1 - np.abs(t), blue], axis=2)).astype(np.uint8))


def row(*pictures: Picture) -> Picture:
    """Pictures side by side, as high as the highest."""
    height = max(picture.pixels.shape[0] for picture in pictures)
    return Picture(
        np.concatenate(
            [np.pad(picture.pixels, ((0, height - picture.pixels.shape[0]), (0, 0), (0, 0))) for picture in pictures],
            axis=1,
        )
    )
