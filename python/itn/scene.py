"""Scenes: from files, text, dictionaries, and files of Mitsuba."""

from __future__ import annotations

import base64
import json
import math
import os
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from . import _core
from .errors import InvalidInput, warn, writing

# Fields that are arrays: of whole numbers, and of so many numbers a row. All others have floats.
_WHOLE = {"indices"}
_COLUMNS = {"positions": 3, "indices": 3, "corner_normals": 9, "rgb": 3}
_BYTES, _VECTORS = (frozenset(names) for names in _core.scene_fields())

_LARGEST = 65535  # of a film, in pixels a side


class Number(NamedTuple):
    """A number of a scene: its value, and the range that it may have."""

    value: float
    low: float
    high: float


class Scene:
    """What is rendered: an object, other surfaces, lights, a camera and a film. It does not change.

    Lengths are in mm, radiance is in W/(m^2 sr). docs/reference/scene.md says what a scene may hold. itn.load and
    itn.scene make one.
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
        sides = (width, width if height is None else height)
        for name, value in zip(("width", "height"), sides):
            if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not 1 <= value <= _LARGEST:
                raise InvalidInput(f"{name} {value!r}: it is a whole number of pixels, from 1 to {_LARGEST}")
        return Scene(self._core.resized(int(sides[0]), int(sides[1])))

    def coloured(self, colour: bool = True) -> Scene:
        """The same scene with an image in colour, or of the luminance."""
        return Scene(self._core.coloured(colour))

    def parameters(self) -> Mapping[str, Number]:
        """The numbers of this scene that renders have derivatives in, by the names that `derivatives`
        and `values` of itn.render take. Those of the medium (sigma_t, albedo, g and others) come
        beside them."""
        return {name: Number(*numbers) for name, *numbers in self._core.numbers()}

    def check(self) -> None:
        """Raises InvalidInput unless the scene can be rendered."""
        self._core.check()

    def to_dict(self) -> dict[str, Any]:
        """The scene as nested dictionaries, of which itn.scene makes an equal one; triangles are arrays."""
        held: dict[str, Any] = _with_arrays(json.loads(self._core.to_json()))
        return held

    def to_text(self) -> str:
        """The scene as the text of a scene file, which stands alone."""
        return self._core.to_text()

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        sigma_t: Any = None,
        albedo: Any = None,
        g: Any = None,
        medium: Any = None,
        object_size: float | None = None,
        phase: str | None = None,
    ) -> None:
        """Writes a scene file; or, if its name ends in .xml, one of Mitsuba 3, and beside it the meshes and pictures
        that it names.

        sigma_t, albedo, g, medium, object_size, phase: the medium in a file of Mitsuba, as of itn.render. Default: the
            scene's own.

        What has no counterpart in Mitsuba is said by a warning. Raises FileError, InvalidInput.
        """
        name = os.fsdecode(path)
        if name.lower().endswith(".xml"):
            from .rendering import request_of

            try:
                name.encode()
            except UnicodeEncodeError:
                raise InvalidInput(f"path {name!r}: Mitsuba reads names in UTF-8") from None
            request, in_colour = request_of(self, sigma_t, albedo, g, medium, object_size, phase)
            request.set_colour(in_colour or self._core.is_in_colour())
            for sentence in _core.write_mitsuba_scene(name, self._core, request):
                warn(f"{name}: {sentence}")
            return
        if any(value is not None for value in (sigma_t, albedo, g, medium, object_size, phase)):
            raise InvalidInput(f"path {name!r}: a medium goes with a file of Mitsuba, whose name ends in .xml")
        with writing(path) as temporary, open(temporary, "w", encoding="utf-8") as file:
            file.write(self.to_text())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Scene) and self.to_text() == other.to_text()

    def __hash__(self) -> int:
        return hash(self.to_text())

    def __getstate__(self) -> str:
        return self._core.to_json()

    def __setstate__(self, state: str) -> None:
        self._core = _core.Scene.of_json(state, ".")

    def __repr__(self) -> str:
        held = json.loads(self._core.to_json())
        lights = [next(iter(light), "?") for light in held.get("lights", [])]
        return (
            f"<itn.Scene: {self.width} x {self.height} pixels, lights: {', '.join(lights) or 'none'}, "
            f"surfaces: {len(held.get('surfaces', []))}>"
        )


def load(
    path: str | os.PathLike[str], *, mm_per_unit: float = 1, definitions: Mapping[str, Any] | None = None
) -> Scene:
    """Reads a scene: a scene file of itn, or an XML file of Mitsuba (0.6 or 3).

    `mm_per_unit` and `definitions`, the values of a file's $names, are of Mitsuba's files alone. What
    of such a file has no counterpart here is said by a warning. Its medium is that of the scene's object. Raises FileError and InvalidInput.
    """
    if not isinstance(path, (str, os.PathLike)):
        raise InvalidInput(f"path {type(path).__name__}: itn.load reads a file; itn.scene takes dictionaries")
    name = os.fspath(path)
    if not name.lower().endswith(".xml"):
        if mm_per_unit != 1 or definitions:
            raise InvalidInput("mm_per_unit and definitions are for XML files of Mitsuba")
        return _said(_core.Scene.load(name))
    given = [(key, str(value)) for key, value in (definitions or {}).items()]
    imported = _core.import_mitsuba(name, float(mm_per_unit), given)
    for sentence in imported.not_carried_over:
        warn(sentence)
    if imported.phase:
        warn(f"{name}: its phase function is for the argument phase of itn.render, not in the scene: {imported.phase}")
    return _said(imported.scene)


def scene(description: Mapping[str, Any] | str, *, folder: str | os.PathLike[str] = ".") -> Scene:
    """Makes a scene of nested dictionaries, or of the text of a scene file.

    Names are those of docs/reference/scene.md. Vectors may be three numbers. Triangles take arrays: `positions` (n, 3)
    and `corner_normals` (n, 9) of floats, `indices` (n, 3) of whole numbers. Paths of meshes and images are relative
    to `folder`. Raises InvalidInput and FileError.
    """
    if isinstance(description, os.PathLike) or isinstance(description, str) and "{" not in description:
        raise InvalidInput(f"{os.fspath(description)!r} is no scene; itn.load reads one from a file")
    if isinstance(description, str):
        return _said(_core.Scene.of_text(description, os.fspath(folder)))
    if not isinstance(description, Mapping):
        raise InvalidInput(f"description {type(description).__name__}: it is a dictionary, or the text of a scene file")
    return _said(_core.Scene.of_json(json.dumps(_plain(description, "", "")), os.fspath(folder)))


def as_scene(given: Any) -> Scene:
    """A scene, that of a file, or that of a dictionary."""
    if isinstance(given, Scene):
        return given
    if isinstance(given, Mapping):
        return scene(given)
    if isinstance(given, (str, os.PathLike)):
        return load(given)
    raise InvalidInput(
        f"scene {type(given).__name__}: it is what itn.load or itn.scene returns, a path, or a dictionary"
    )


def _said(core: _core.Scene) -> Scene:
    """With what was said of its files."""
    for message in _core.take_messages():
        warn(message)
    return Scene(core)


def _plain(value: Any, name: str, place: str) -> Any:
    """What JSON can say of the value of a field: arrays are bytes there."""
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    if name in _BYTES and not isinstance(value, str):
        return base64.b64encode(_rows(value, name, place).tobytes()).decode()
    if isinstance(value, Mapping):
        return {str(key): _plain(held, str(key), f"{place}.{key}".lstrip(".")) for key, held in value.items()}
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "tolist"):  # of NumPy or PyTorch
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        if name in _VECTORS and len(value) == 3 and not any(isinstance(part, Mapping) for part in value):
            return {axis: _plain(part, axis, f"{place}.{axis}") for axis, part in zip("xyz", value)}
        return [_plain(held, name, f"{place}[{i}]") for i, held in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        raise InvalidInput(f"{place} is {value}; it must be finite")
    return value


def _rows(value: Any, name: str, place: str) -> npt.NDArray[Any]:
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise InvalidInput(f"{place}: it is an array of numbers: {error}") from None
    columns = _COLUMNS.get(name)
    in_rows = array.ndim == 1 and columns and array.size % columns == 0 or array.ndim > 1 and array.shape[-1] == columns
    if columns and not in_rows:
        raise InvalidInput(f"{place}: an array of the shape {array.shape}; it is (..., {columns})")
    if name in _WHOLE:
        if array.size and (array.dtype.kind not in "iu" or array.min() < 0 or array.max() >= 1 << 32):
            raise InvalidInput(f"{place}: they are whole numbers from 0 on")
        return np.ascontiguousarray(array, dtype="<u4")
    if array.dtype.kind not in "iufb":
        raise InvalidInput(f"{place}: an array of {array.dtype}; it is one of numbers")
    return np.ascontiguousarray(array, dtype="<f4")


def _with_arrays(value: Any, name: str = "") -> Any:
    if isinstance(value, dict):
        return {key: _with_arrays(held, key) for key, held in value.items()}
    if isinstance(value, list):
        return [_with_arrays(held, name) for held in value]
    if name in _BYTES and value:
        array = np.frombuffer(base64.b64decode(value), dtype="<u4" if name in _WHOLE else "<f4")
        return array.reshape(-1, _COLUMNS.get(name, 1))
    return value
