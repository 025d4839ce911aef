"""Datasets that `itn dataset` rendered."""

from __future__ import annotations

import os
import pathlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from . import _core
from .errors import InvalidInput

_SPLITS = ("train", "validation", "test")


class Dataset:
    """The images of a split of a dataset, with their truth. torch.utils.data.DataLoader takes it as it is, by
    processes that are forked or spawned.

    folder: that of `itn dataset`; it must be complete.
    split: "train", "validation", "test" (of other shapes each), or "all".

    An item is a dictionary: image, (height, width), in colour (height, width, 3), radiance in W/(m^2 sr); stderr, of
    the same shape; mask, (height, width), the part of each pixel that the object covers; sigma_t (1/mm), albedo and g,
    of one number, in colour of three; index, its number.
    """

    def __init__(self, folder: str | os.PathLike[str], split: str = "train"):
        if split not in (*_SPLITS, "all"):
            raise InvalidInput(f"split {split!r}: it is one of {', '.join(_SPLITS)}, all")
        self._folder = pathlib.Path(folder).absolute()
        items = _core.read_manifest(str(self._folder / "manifest.textproto"))
        self._items = [
            (file, shape, materials) for file, of_split, shape, materials in items if split in (of_split, "all")
        ]

    def __len__(self) -> int:
        return len(self._items)

    def __getitem__(self, index: int) -> dict[str, Any]:
        number = range(len(self))[index]
        file, _, materials = self._items[number]
        layers = dict(_core.read_exr(str(self._folder / file)))
        colours = ["Y"] if "Y" in layers else ["R", "G", "B"]

        def together(prefix: str) -> Any:
            planes = [layers[prefix + colour] for colour in colours]
            return planes[0] if len(planes) == 1 else np.stack(planes, axis=-1)

        truth = np.array(materials, dtype=np.float32)
        return {
            "image": together(""),
            "stderr": together("stderr."),
            "mask": layers["mask.Y"],
            "sigma_t": truth[:, 0],
            "albedo": truth[:, 1],
            "g": truth[:, 2],
            "index": number,
        }

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return (self[i] for i in range(len(self)))

    def shape_of(self, index: int) -> str:
        """The name of the shape that an item shows."""
        return self._items[index][1]

    def __repr__(self) -> str:
        return f"<itn.Dataset: {len(self)} images of {len({shape for _, shape, _ in self._items})} shapes>"
