"""Scenes: from files, text, dictionaries, and files of Mitsuba."""
from __future__ import annotations

import base64
import json
import os
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from . import _core
from .errors import InvalidInput, warn


class Number(NamedTuple):
    """A number of a scene: its value, and the range that it may have."""

    value: float
    low: float
    high: float


class Scene:
    """What is rendered: an object, other surfaces, lights, a camera and a film. It does not change.

    Lengths are in mm, radiance is in W/(m^2 sr). docs/reference/scene.md says what a scene may hold.
    """

    __slots__ = ("_core",)

    def __init__(self, core: _core.Scene):
        self._core = core

    @property
    def width(self) -> int:
        """Width of the image, in pixels."""
        return self._core.width()

    @property
    def height(self) -> int:
        """Height of the image, in pixels."""
        return self._core.height()

    def resized(self, width: int, height: int | None = None) -> Scene:
        """The same scene with an image of so many pixels; square without a height."""
        height = width if height is None else height
        for name, value in (("width", width), ("height", height)):
            if not isinstance(value, (int, np.integer)) or not 1 <= value < 1 << 16:
                raise InvalidInput(f"{name} {value!r}: it is a whole number of pixels, from 1 on")
        return Scene(self._core.resized(int(width), int(height)))

    def parameters(self) -> Mapping[str, Number]:
        """The numbers of this scene that renders have derivatives in, by the names that `derivatives`
        and `values` of itn.render take. Those of the medium (sigma_t, albedo, g and others) come
        beside them."""
        return {name: Number(*numbers) for name, *numbers in self._core.numbers()}

    def check(self) -> None:
        """Raises InvalidInput unless the scene can be rendered."""
        self._core.check()

    def to_dict(self) -> dict[str, Any]:
        """The scene as nested dictionaries, of which itn.scene makes an equal one."""
        held: dict[str, Any] = json.loads(self._core.to_json())
        return held

    def to_text(self) -> str:
        """The scene as the text of a scene file, which stands alone."""
        return self._core.to_text()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes a scene file."""
        temporary = f"{os.fspath(path)}.{os.getpid()}.part"
        try:
            with open(temporary, "w", encoding="utf-8") as file:
                file.write(self.to_text())
            os.replace(temporary, path)
        finally:
            if os.path.exists(temporary):
                os.unlink(temporary)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Scene) and self.to_text() == other.to_text()

    def __hash__(self) -> int:
        return hash(self.to_text())

    def __getstate__(self) -> str:
        return self._core.to_json()

    def __setstate__(self, state: str) -> None:
        self._core = _core.Scene.of_json(state, ".")

    def __repr__(self) -> str:
        held = self.to_dict()
        lights = [next(iter(light), "?") for light in held.get("lights", [])]
        return (f"<itn.Scene: {self.width} x {self.height} pixels, lights: {', '.join(lights) or 'none'}, "
                f"surfaces: {len(held.get('surfaces', []))}>")


def load(path: str | os.PathLike[str], *, mm_per_unit: float = 1,
         definitions: Mapping[str, Any] | None = None) -> Scene:
    """Reads a scene: a scene file of itn, or an XML file of Mitsuba (0.6 or 3).

    `mm_per_unit` and `definitions`, the values of a file's $names, are of Mitsuba's files alone. What
    of such a file has no counterpart here is said by a warning; its medium becomes that of the
    object. Raises FileError and InvalidInput.
    """
    name = os.fspath(path)
    if not name.lower().endswith(".xml"):
        if mm_per_unit != 1 or definitions:
            raise InvalidInput("mm_per_unit and definitions are for XML files of Mitsuba")
        return Scene(_core.Scene.load(name))
    given = [(key, str(value)) for key, value in (definitions or {}).items()]
    imported = _core.import_mitsuba(name, float(mm_per_unit), given)
    for sentence in imported.not_carried_over:
        warn(f"{name}: {sentence}")
    return Scene(imported.scene)


def scene(description: Mapping[str, Any] | str, *, folder: str | os.PathLike[str] = ".") -> Scene:
    """Makes a scene of nested dictionaries, or of the text of a scene file.

    Names are those of docs/reference/scene.md. Triangles take NumPy arrays: `positions`
    and `corner_normals` of floats, `indices` of whole numbers. Paths of meshes and images are relative to `folder`.
    Raises InvalidInput and FileError.
    """
    if isinstance(description, str):
        return Scene(_core.Scene.of_text(description, os.fspath(folder)))
    return Scene(_core.Scene.of_json(json.dumps(_plain(description)), os.fspath(folder)))


def _plain(value: Any) -> Any:
    """What JSON can say of it: arrays of numbers are bytes there."""
    if isinstance(value, Mapping):
        return {str(key): _plain(held) for key, held in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(held) for held in value]
    if isinstance(value, (np.floating, np.integer, np.bool_)):
        return value.item()
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    if hasattr(value, "__dlpack__") or isinstance(value, np.ndarray):
        array = np.asarray(value)
        if array.ndim == 0:
            return array.item()
        kind = "<u4" if array.dtype.kind in "iu" else "<f4"
        if kind == "<u4" and array.size and (array.min() < 0 or array.max() >= 1 << 32):
            raise InvalidInput("indices: they are whole numbers from 0 on")
        return base64.b64encode(np.ascontiguousarray(array, dtype=kind).tobytes()).decode()
    return value
