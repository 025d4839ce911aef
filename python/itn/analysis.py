"""Materials from images: by a network, by inverse rendering of a known scene, or of a known shape."""

from __future__ import annotations

import json
import os
import pathlib
import shutil
import tempfile
import weakref
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _core, programs
from .errors import Error, InvalidInput
from .rendering import Render
from .scene import Scene, as_scene
from .workers import addresses_of

_FORMATS = {".mtlx": "openpbr", ".xml": "mitsuba", ".pbrt": "pbrt", ".py": "blender", ".ass": "arnold"}

#: A file; a Render; or an array of linear radiance: (height, width), or (height, width, 3) of red, green and blue.
Picture = str | os.PathLike[str] | Render | npt.NDArray[Any]


class Answer:
    """A material as it was found: numbers of red, green and blue, or of one channel, and how sure they are.

    Every number is an array with one value for each channel.
    """

    #: What an interval holds, in percent.
    percent = 90

    def __init__(self, found: dict[str, Any], channels: list[dict[str, Any]], low: str, high: str):
        self._found, self._channels, self._low, self._high = found, channels, low, high

    def _values(self, name: str, part: str) -> npt.NDArray[np.float64]:
        known = [key for key, held in self._channels[0].items() if isinstance(held, dict) and part in held]
        if name not in known:
            raise InvalidInput(f"{name}: there are {', '.join(known)}")
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

    def __repr__(self) -> str:
        lines = [f"<itn.{type(self).__name__}, {self.percent} % intervals"]
        for name in ("sigma_t", "albedo", "g"):
            told = ", ".join(
                f"{value:.3g} ({low:.3g} to {high:.3g})"
                for value, (low, high) in zip(self.value(name), self.interval(name))
            )
            lines.append(f"  {name}: {told}")
        return "\n".join(lines + [f"  {remark}" for remark in self.remarks]) + ">"


def _format_of(path: str | os.PathLike[str], format: str | None) -> str:
    if format is not None:
        return format
    try:
        return _FORMATS[pathlib.Path(path).suffix.lower()]
    except KeyError:
        raise InvalidInput(
            f"{os.fspath(path)}: its name ends in {', '.join(_FORMATS)}, or format says what it " "is"
        ) from None


class Prediction(Answer):
    """What a network says of a photograph, or of several of one material."""

    def __init__(self, found: dict[str, Any], positional: list[str], flags: dict[str, Any], files: Files):
        channels = [
            {
                name: {**numbers, "value": channel.get(name, numbers["mean"])}
                for name, numbers in channel["posterior"].items()
                if isinstance(numbers, dict)
            }
            for channel in found["channels"]
        ]
        super().__init__(found, channels, "low", "high")
        self._positional, self._flags, self._files = positional, flags, files

    @property
    def remarks(self) -> list[str]:
        """What limits the answer, in words."""
        return list(
            dict.fromkeys(
                warning["text"]
                for channel in self._found["channels"]
                for warning in channel.get("caveats", {}).get("warnings", [])
            )
        )

    def write(self, path: str | os.PathLike[str], format: str | None = None) -> None:
        """Writes the material for a renderer, by the ending of the file's name: .mtlx (OpenPBR in MaterialX), .xml
        (Mitsuba), .pbrt, .py (Blender), .ass (Arnold). Predicts once more, and needs the photograph."""
        programs.run(
            "predict",
            self._positional,
            {**self._flags, "format": _format_of(path, format), "output": os.path.abspath(path)},
            names=self._files.names,
            warns=False,
        )


class Refinement(Answer):
    """What inverse rendering found."""

    percent = 95

    def __init__(self, found: dict[str, Any], results: list[dict[str, Any]], folder: str, files: Files):
        super().__init__(found, results, "low_95", "high_95")
        #: Where the files are that the program left: scene, pictures, result.
        self.folder = folder
        self._files = files

    @property
    def remarks(self) -> list[str]:
        """What limits the answer, in words."""
        return list(dict.fromkeys(remark for result in self._channels for remark in result.get("remarks", [])))

    @property
    def trajectory(self) -> list[dict[str, Any]]:
        """What each iteration was: materials, loss, spp, seconds and so on (RefineIteration in
        docs/reference/refine.md)."""
        return [json.loads(line) for line in _lines_of_iterations(self.folder)]

    @property
    def misfit(self) -> bool:
        """Whether image and renders differ by more than noise: no interval holds then."""
        return any(result.get("misfit", False) for result in self._channels)

    def write(self, path: str | os.PathLike[str], format: str | None = None) -> None:
        """Writes the material for a renderer, by the ending of the file's name: .mtlx (OpenPBR in MaterialX), .xml
        (Mitsuba), .pbrt, .py (Blender), .ass (Arnold)."""
        surface: dict[str, Any] = {
            name: self._channels[0][name] for name in ("index", "roughness") if name in self._channels[0]
        }
        programs.run(
            "materials",
            [],
            {
                **{
                    name: [float(result["material"].get(name, 0)) for result in self._channels]
                    for name in ("sigma_t", "albedo", "g")
                },
                **surface,
                "format": _format_of(path, format),
                "output": os.path.abspath(path),
            },
        )


class Files:
    """Files for the programs: those that were given, and those that arrays become. Copies share them."""

    def __init__(self) -> None:
        self.folder = tempfile.mkdtemp(prefix="itn-")
        weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)
        #: What messages call files that the user did not name.
        self.names: dict[str, str] = {}
        #: Whether a Render or an array was.
        self.any_in_colour = False
        self._count = 0

    def __copy__(self) -> Files:
        return self

    def __deepcopy__(self, _: Any) -> Files:
        return self

    def new(self, ending: str, name: str) -> str:
        self._count += 1
        path = os.path.join(self.folder, f"{self._count}{ending}")
        self.names[path] = name
        return path

    def picture(self, picture: Any, name: str, is_mask: bool = False) -> str:
        if isinstance(picture, (str, os.PathLike)):
            return os.path.abspath(picture)
        if isinstance(picture, Render):
            path = self.new(".exr", name)
            picture.write(path)
            self.any_in_colour |= picture.image.ndim == 3
            return path
        try:
            array = np.asarray(picture)
        except (TypeError, ValueError, RuntimeError) as error:
            raise InvalidInput(f"{name}: it is a file, a Render or an array: {error}") from None
        if array.ndim not in (2, 3) or array.ndim == 3 and array.shape[2] not in (1, 3) or array.size == 0:
            raise InvalidInput(
                f"{name}: it is a file, a Render, or an array of the shape (height, width) or (height, "
                f"width, 3)" + (f", not {array.shape}" if array.ndim else "")
            )
        if is_mask and array.dtype.kind in "ui":
            array = array / np.float32(max(1, array.max()))
        elif array.dtype.kind not in "fb":
            raise InvalidInput(
                f"{name}: an array of {array.dtype}; arrays are linear radiance, of floats. Give files of "
                "photographs by their path"
            )
        planes = [array] if array.ndim == 2 else [array[..., c] for c in range(array.shape[2])]
        if not all(np.isfinite(plane).all() for plane in planes):
            raise InvalidInput(f"{name}: it has numbers that are not finite")
        path = self.new(".exr", name)
        self.any_in_colour |= len(planes) == 3 and not is_mask
        _core.write_exr(
            path,
            [
                (channel, np.ascontiguousarray(plane, dtype=np.float32))
                for channel, plane in zip("Y" if len(planes) == 1 else "RGB", planes)
            ],
        )
        return path

    def linked(self, pictures: Sequence[Any], kind: str) -> list[str]:
        """Names for pictures in a folder of their own, by which their masks are found."""
        folder = self.new("", f"the {kind}s")
        os.mkdir(folder)
        paths = []
        for i, picture in enumerate(pictures):
            path = self.picture(picture, f"{kind} {i}", is_mask=kind == "mask")
            paths.append(os.path.join(folder, f"{i:06}{pathlib.Path(path).suffix}"))
            self.names[paths[-1]] = f"{kind} {i}"
            os.symlink(path, paths[-1])
        return paths

    def scene(self, scene: Any, in_colour: bool) -> str:
        """A scene's file, whose film is in colour if the images are."""
        if isinstance(scene, (str, os.PathLike)) and not in_colour:
            return os.path.abspath(scene)
        held = as_scene(scene)
        path = self.new(".textproto", "the scene")
        (held.coloured() if in_colour else held).save(path)
        return path

    def flags(self, flags: dict[str, Any]) -> dict[str, Any]:
        """With pictures among them as files."""
        made = dict(flags)
        if made.get("mask") is not None:
            made["mask"] = self.picture(made["mask"], "mask", is_mask=True)
        for name in ("shape", "light"):
            value = made.get(name)
            if isinstance(value, (str, os.PathLike)) and os.path.exists(value):
                made[name] = os.path.abspath(value)
            elif name == "light" and value is not None and not isinstance(value, str):
                made[name] = self.picture(value, name)
        return made


def _lines_of_iterations(folder: str) -> list[str]:
    """A JSON object for each that there is by now."""
    try:
        with open(os.path.join(folder, "trajectory.jsonl"), encoding="utf-8") as lines:
            return list(lines)
    except (FileNotFoundError, NotADirectoryError):
        return []


def _several(pictures: Any) -> list[Any]:
    return (
        list(pictures)
        if isinstance(pictures, (list, tuple))
        and pictures
        and not np.isscalar(pictures[0])
        and (isinstance(pictures[0], (str, os.PathLike, Render)) or hasattr(pictures[0], "shape"))
        else [pictures]
    )


def _named(pictures: list[Any], files: Files) -> list[str]:
    return [
        files.picture(picture, "image" if len(pictures) == 1 else f"image {i}") for i, picture in enumerate(pictures)
    ]


def predict(
    photograph: Picture | Sequence[Picture],
    *,
    mask: Picture | None = None,
    object_size: float | None = None,
    **flags: Any,
) -> Prediction:
    """Reads a material off a photograph, or off several of one material, by a network.

    photograph: a file that `itn predict` reads, a Render, or an array of linear radiance; or a list of them, which show
        one material.
    mask: an image that is bright on the object. Default: a Render's own; background="auto" finds the object before a
        plain background.
    object_size: the longest side of the object, in mm; default: unknown, and sigma_t is for an object of 1 mm.
    flags: of `itn predict` (docs/reference/commands.md), with underscores: matt=True, model="card",
        gray_card=(10, 20, 40, 40), encoding="linear".

    Runs the program itn. Raises InvalidInput, FileError.
    """
    files = Files()
    pictures = _several(photograph)
    positional = _named(pictures, files)
    given = files.flags({"mask": mask, "object_size": object_size, **flags})
    if len(pictures) > 1:
        given["one_material"] = True
    said = programs.run("predict", positional, {**given, "json": True}, names=files.names)
    return Prediction(json.loads(said.splitlines()[-1]), positional, given, files)


def predict_many(
    photographs: Sequence[Picture],
    *,
    masks: Sequence[Picture] | None = None,
    object_size: float | None = None,
    **flags: Any,
) -> list[Prediction | Error]:
    """Reads a material off each of many photographs, in one process, as the start takes longest of one.

    photographs, masks: as of predict(), one mask for each photograph; Renders bring their own.
    object_size, flags: as of predict(), the same for all.

    Returns an answer for each, in their order; of a photograph that cannot be used, an Error.
    """
    files = Files()
    if not len(photographs):
        return []
    if masks is not None and len(masks) != len(photographs):
        raise InvalidInput(f"masks: there are {len(masks)}, and {len(photographs)} photographs")
    linked = files.linked(photographs, "image")
    given = {"object_size": object_size, **flags}
    if masks is not None:
        given["mask"] = os.path.dirname(files.linked(masks, "mask")[0])
    said = programs.run("predict", linked, {**given, "json": True}, names=files.names, accepts=range(2, 8))
    found = [json.loads(line) for line in said.splitlines()]
    if len(found) != len(linked):
        raise Error(f"itn predict answered for {len(found)} of {len(linked)} photographs: {said[:200]}")
    return [
        (
            InvalidInput(programs.with_names(one["error"], files.names))
            if one["error"]
            else Prediction(one, [path], given, files)
        )
        for path, one in zip(linked, found)
    ]


def refine(
    images: Picture | Sequence[Picture],
    scene: Scene | Mapping[str, Any] | str | os.PathLike[str] | Sequence[Any],
    *,
    output: str | os.PathLike[str] | None = None,
    progress: Callable[[dict[str, Any]], Any] | None = None,
    **flags: Any,
) -> Refinement:
    """Finds the material for which renders of a known scene are like the images.

    images: files, Renders or arrays of linear radiance, one or several. A Render brings its mask and its noise.
    scene: of all images, or a list of one for each. Of Renders and arrays in colour, their films are, too.
    output: a folder from which the same call goes on, if it is stopped; default: one that goes with the answer.
    progress: called after each iteration with what Refinement.trajectory has of it; what it raises ends this.
    flags: of `itn refine` (docs/reference/commands.md), with underscores: init="mean", mask=..., time_limit=60,
        unknown_exposure=True, workers="host:50051".

    Runs the program itn. Raises InvalidInput, FileError, Unavailable.
    """
    files = Files()
    pictures = _several(images)
    scenes = list(scene) if isinstance(scene, (list, tuple)) else [scene]
    if len(scenes) not in (1, len(pictures)):
        raise InvalidInput(
            f"scene: there are {len(scenes)}, and {len(pictures)} images; give one for all, or one for each"
        )
    positional = _named(pictures, files)
    flags = {"init": "mean", **flags, "scene": [files.scene(one, files.any_in_colour) for one in scenes]}
    return _refinement("refine", positional, output, progress, flags, files)


def fit(
    photographs: Picture | Sequence[Picture],
    *,
    shape: str | os.PathLike[str] | None = None,
    object_size: float | Sequence[float] | None = None,
    light: str | os.PathLike[str] = "flash",
    output: str | os.PathLike[str] | None = None,
    progress: Callable[[dict[str, Any]], Any] | None = None,
    **flags: Any,
) -> Refinement:
    """Finds the material of an object of known shape from its photographs.

    photographs: files, or arrays of linear radiance, one or several.
    shape: an STL, PLY or OBJ file, or a name that `itn shapes` lists; where it stands is found.
    object_size: its longest side, in mm.
    light: "flash", "sun", or the file of a panorama.
    output: a folder for what is found; default: one that goes with the answer.
    progress: called after each iteration of the refinement, as of refine().
    flags: of `itn fit` (docs/reference/commands.md), with underscores: mask=..., background="auto",
        gray_card=(80, 140, 80, 80), time_limit=120. The time is that of the refinement; search and report take more.

    Runs the program itn. Raises InvalidInput, FileError, Unavailable.
    """
    files = Files()
    given = {"shape": shape, "object_size": object_size, "light": light, **flags}
    if given.get("scene") is not None:
        scenes = given["scene"] if isinstance(given["scene"], (list, tuple)) else [given["scene"]]
        given["scene"] = [files.scene(one, False) for one in scenes]
    return _refinement("fit", _named(_several(photographs), files), output, progress, given, files)


def _refinement(
    command: str,
    positional: list[str],
    output: str | os.PathLike[str] | None,
    progress: Callable[[dict[str, Any]], Any] | None,
    flags: dict[str, Any],
    files: Files,
) -> Refinement:
    if output is not None and (not os.fspath(output) or "\0" in os.fsdecode(output)):
        raise InvalidInput(f"output {output!r}: it is the name of a folder")
    if flags.get("workers") is not None:
        flags = {**flags, "workers": addresses_of(flags["workers"])}
    folder = os.path.abspath(output) if output is not None else files.new("", "the folder of the answer")
    said = _lines_of_iterations(folder)

    def watch() -> None:
        nonlocal said
        done = _lines_of_iterations(folder)
        # One that was not finished before is done again.
        same = len(os.path.commonprefix([said, done]))
        said = done
        for line in done[same:]:
            if progress is not None:
                progress(json.loads(line))

    given = {**files.flags(flags), "output": folder, "json": True}
    found = json.loads(
        programs.run(command, positional, given, names=files.names, watch=watch if progress is not None else None)
    )
    if progress is not None:
        watch()
    return Refinement(found, found["results"] if "results" in found else [found], folder, files)
