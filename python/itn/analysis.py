"""Materials from images: by a network, by inverse rendering of a known scene, or of a known shape."""
from __future__ import annotations

import json
import os
import pathlib
import tempfile
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _core, programs
from .errors import InvalidInput
from .scene import Scene

_FORMATS = {".mtlx": "openpbr", ".xml": "mitsuba", ".pbrt": "pbrt", ".py": "blender", ".ass": "arnold"}

#: A file, or an array: (height, width), or (height, width, 3) of red, green and blue; linear radiance.
Picture = str | os.PathLike[str] | npt.NDArray[Any]


class Answer:
    """A material as it was found: numbers of red, green and blue, or of one channel, and how sure they are.

    Every number is an array with one value for each channel.
    """

    #: What an interval holds, in percent.
    percent = 90

    def __init__(self, found: dict[str, Any], channels: list[dict[str, Any]], low: str, high: str):
        self._found, self._channels, self._low, self._high = found, channels, low, high

    def _values(self, name: str, part: str) -> npt.NDArray[np.float64]:
        return np.array([channel[name][part] for channel in self._channels])

    def value(self, name: str) -> npt.NDArray[np.float64]:
        """The best guess of sigma_t, sigma_a, sigma_s_reduced (1/mm), albedo, g, diffuse_albedo or diffusion_length
        (mm)."""
        return self._values(name, "value")

    def interval(self, name: str) -> npt.NDArray[np.float64]:
        """(low, high) of the interval that holds the truth in `percent` of all cases: an array of channels x 2."""
        return np.stack([self._values(name, self._low), self._values(name, self._high)], axis=1)

    @property
    def sigma_t(self) -> npt.NDArray[np.float64]:
        """Extinction, in 1/mm."""
        return self.value("sigma_t")

    @property
    def albedo(self) -> npt.NDArray[np.float64]:
        """Single-scattering albedo."""
        return self.value("albedo")

    @property
    def g(self) -> npt.NDArray[np.float64]:
        """Mean cosine of scattering."""
        return self.value("g")

    @property
    def remarks(self) -> list[str]:
        """What limits the answer, in words."""
        return []

    def to_dict(self) -> dict[str, Any]:
        """All that was found, as the program says it with --json."""
        return self._found

    def _format(self, path: str | os.PathLike[str], format: str | None) -> str:
        if format is not None:
            return format
        try:
            return _FORMATS[pathlib.Path(path).suffix.lower()]
        except KeyError:
            raise InvalidInput(f"{os.fspath(path)}: its name ends in {', '.join(_FORMATS)}, or format says what it "
                               "is") from None

    def __repr__(self) -> str:
        names = ("sigma_t", "albedo", "g")
        lines = [f"<itn.{type(self).__name__}, {self.percent} % intervals"]
        for name in names:
            told = ", ".join(f"{value:.3g} ({low:.3g} to {high:.3g})"
                             for value, (low, high) in zip(self.value(name), self.interval(name)))
            lines.append(f"  {name}: {told}")
        return "\n".join(lines + [f"  {remark}" for remark in self.remarks]) + ">"


class Prediction(Answer):
    """What a network says of a photograph."""

    def __init__(self, found: dict[str, Any], positional: list[str], flags: dict[str, Any], held: Any):
        channels = [{name: {**numbers, "value": channel.get(name, numbers["mean"])}
                     for name, numbers in channel["posterior"].items() if isinstance(numbers, dict)}
                    for channel in found["channels"]]
        super().__init__(found, channels, "low", "high")
        self._positional, self._flags, self._held = positional, flags, held

    @property
    def remarks(self) -> list[str]:
        return list(dict.fromkeys(warning["text"] for channel in self._found["channels"]
                                  for warning in channel.get("caveats", {}).get("warnings", [])))

    def write(self, path: str | os.PathLike[str], format: str | None = None) -> None:
        """Writes the material for a renderer, by the ending of the file's name: .mtlx (OpenPBR in MaterialX), .xml
        (Mitsuba), .pbrt, .py (Blender), .ass (Arnold). Predicts once more, and needs the photograph."""
        programs.run("predict", self._positional,
                     {**self._flags, "format": self._format(path, format), "output": os.path.abspath(path)})


class Refinement(Answer):
    """What inverse rendering found."""

    percent = 95

    def __init__(self, found: dict[str, Any], results: list[dict[str, Any]], folder: str, held: Any):
        super().__init__(found, results, "low_95", "high_95")
        #: Where the files are that the program left: scene, pictures, result.
        self.folder = folder
        self._held = held

    @property
    def remarks(self) -> list[str]:
        return list(dict.fromkeys(remark for result in self._channels for remark in result.get("remarks", [])))

    @property
    def misfit(self) -> bool:
        """Whether image and renders differ by more than noise: no interval holds then."""
        return any(result.get("misfit", False) for result in self._channels)

    def write(self, path: str | os.PathLike[str], format: str | None = None) -> None:
        """Writes the material for a renderer, by the ending of the file's name: .mtlx (OpenPBR in MaterialX), .xml
        (Mitsuba), .pbrt, .py (Blender), .ass (Arnold)."""
        several = len(self._channels) == 3
        folders = [os.path.join(self.folder, name) for name in "RGB"] if several else [self.folder]
        programs.run("materials", [], {"refined": folders, "format": self._format(path, format),
                                       "output": os.path.abspath(path)})


class _Files:
    """Files for the programs: those that were given, and those that arrays become."""

    def __init__(self) -> None:
        self.folder = tempfile.TemporaryDirectory(prefix="itn-")
        self._count = 0

    def new(self, ending: str) -> str:
        self._count += 1
        return os.path.join(self.folder.name, f"{self._count}{ending}")

    def picture(self, picture: Picture) -> str:
        if isinstance(picture, (str, os.PathLike)):
            return os.path.abspath(picture)
        array = np.asarray(picture)
        if array.ndim not in (2, 3) or array.ndim == 3 and array.shape[2] not in (1, 3) or array.size == 0:
            raise InvalidInput(f"an image of the shape {array.shape}: it is (height, width), or (height, width, 3)")
        if array.dtype.kind not in "fb":
            raise InvalidInput(f"an image of {array.dtype}: arrays are linear radiance, of floats; give files of "
                               "photographs by their path")
        planes = [array] if array.ndim == 2 else [array[..., c] for c in range(array.shape[2])]
        path = self.new(".exr")
        _core.write_exr(path, [(name, np.ascontiguousarray(plane, dtype=np.float32))
                               for name, plane in zip("Y" if len(planes) == 1 else "RGB", planes)])
        return path

    def scene(self, scene: Scene | str | os.PathLike[str]) -> str:
        if isinstance(scene, Scene):
            path = self.new(".textproto")
            scene.save(path)
            return path
        return os.path.abspath(scene)

    def flags(self, flags: dict[str, Any]) -> dict[str, Any]:
        """With pictures and scenes among them as files."""
        made = dict(flags)
        for name in ("mask", "shape", "light"):
            value = made.get(name)
            if isinstance(value, np.ndarray):
                made[name] = self.picture(value)
            elif value is not None and os.path.exists(value):
                made[name] = os.path.abspath(value)
        if made.get("scene") is not None:
            scenes = made["scene"] if isinstance(made["scene"], (list, tuple)) else [made["scene"]]
            made["scene"] = [self.scene(scene) for scene in scenes]
        return made


def _several(pictures: Picture | Sequence[Picture]) -> list[Picture]:
    if isinstance(pictures, (str, os.PathLike, np.ndarray)):
        return [pictures]
    return list(pictures)


def predict(photograph: Picture, *, mask: Picture | None = None, object_size: float | None = None,
            **flags: Any) -> Prediction:
    """Reads a material off a photograph, by a network.

    photograph: a file that `itn predict` reads, or an array of linear radiance.
    mask: an image that is bright on the object. Without one, background="auto" finds the object before a plain
        background.
    object_size: the longest side of the object, in mm; default: unknown, and sigma_t is for an object of 1 mm.
    flags: of `itn predict` (docs/reference/itn-predict.md), with underscores: matt=True, model="card",
        gray_card=(10, 20, 40, 40), encoding="linear".

    Runs the program itn. Raises InvalidInput, FileError.
    """
    files = _Files()
    positional = [files.picture(photograph)]
    given = files.flags({"mask": mask, "object_size": object_size, **flags})
    found = json.loads(programs.run("predict", positional, {**given, "json": True}).splitlines()[-1])
    return Prediction(found, positional, given, files)


def refine(images: Picture | Sequence[Picture], scene: Scene | str | os.PathLike[str] | Sequence[Any], *,
           output: str | os.PathLike[str] | None = None, **flags: Any) -> Refinement:
    """Finds the material for which renders of a known scene are like the images.

    images: files or arrays of linear radiance, one or several.
    scene: of all images, or a sequence of one for each.
    output: a folder from which the same call goes on, if it is stopped; default: one that goes with the answer.
    flags: of `itn refine` (docs/reference/itn-refine.md), with underscores: init="mean", unknown_exposure=True,
        workers="host:50051".

    Runs the program itn. Raises InvalidInput, FileError, Unavailable.
    """
    return _refinement("refine", images, output, {"scene": scene, "init": "mean", **flags})


def fit(photographs: Picture | Sequence[Picture], *, shape: str | os.PathLike[str] | None = None,
        object_size: float | Sequence[float] | None = None, light: str | os.PathLike[str] = "flash",
        output: str | os.PathLike[str] | None = None, **flags: Any) -> Refinement:
    """Finds the material of an object of known shape from its photographs.

    photographs: files, or arrays of linear radiance, one or several.
    shape: an STL, PLY or OBJ file, or a name that `itn shapes` lists; where it stands is found.
    object_size: its longest side, in mm.
    light: "flash", "sun", or the file of a panorama.
    output: a folder for what is found; default: one that goes with the answer.
    flags: of `itn fit` (docs/reference/itn-fit.md), with underscores: mask=..., background="auto",
        gray_card=(80, 140, 80, 80), time_limit=120.

    Runs the program itn. Raises InvalidInput, FileError, Unavailable.
    """
    return _refinement("fit", photographs, output,
                       {"shape": shape, "object_size": object_size, "light": light, **flags})


def _refinement(command: str, pictures: Picture | Sequence[Picture], output: str | os.PathLike[str] | None,
                flags: dict[str, Any]) -> Refinement:
    files = _Files()
    folder = os.path.abspath(output) if output is not None else files.new("")
    positional = [files.picture(picture) for picture in _several(pictures)]
    found = json.loads(programs.run(command, positional, {**files.flags(flags), "output": folder, "json": True}))
    return Refinement(found, found["results"] if "results" in found else [found], folder, files)
