"""Renders: images of a scene, and derivatives in its numbers."""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from . import _core, pictures
from .errors import Cancelled, Error, InvalidInput, warn
from .media import Medium
from .pictures import Picture
from .scene import Scene, as_scene
from .workers import Asked, Workers, asked

Array = npt.NDArray[np.float32]

#: A number, or three of red, green and blue.
Numbers = float | Sequence[float] | npt.NDArray[Any]

T = TypeVar("T")

MAX_SEED = (1 << 64) - 1
_COUNTERS = ("paths", "steps", "invalid_samples", "leaks", "cpu_seconds")


@dataclass(frozen=True)
class Render:
    """An image and what is known of it. Arrays are of float32, of the shape (height, width), of an
    image in colour (height, width, 3), top row first; they can be written to."""

    #: Radiance, in W/(m^2 sr).
    image: Array
    #: Standard error of `image`; 0 where there is one sample only.
    stderr: Array
    #: The part of each pixel that the object covers, (height, width).
    mask: Array
    #: By name: the derivative of `image`, in radiance by the unit of the number.
    derivatives: dict[str, Array]
    #: By name: the standard error of that; empty unless there are two estimates at least.
    derivative_stderr: dict[str, Array]
    #: `image` of each estimate, (estimates, height, width) or (estimates, height, width, 3).
    estimates: Array
    #: By name: the derivative of each estimate, of the same shape.
    derivative_estimates: dict[str, Array]
    #: Samples per pixel.
    spp: int
    #: That it took.
    seconds: float
    #: (sigma_t, albedo, g) of each channel; sigma_t in 1/mm.
    materials: list[tuple[float, float, float]]
    #: paths, steps, invalid_samples, leaks, cpu_seconds.
    counters: dict[str, float] = field(default_factory=dict)

    @property
    def noise(self) -> float:
        """The root mean square of the standard error of the pixels that see the object, over their mean
        radiance: of the noisiest channel. Of all pixels if none sees it; 0 if they are dark. One sample does
        not tell: nan."""
        if self.spp == 1:
            return float("nan")
        return max(
            _core.noise_on_object(np.ascontiguousarray(image), np.ascontiguousarray(error), self.mask)
            for image, error in zip(self._channels(self.image), self._channels(self.stderr))
        )

    @staticmethod
    def _channels(array: Array) -> list[Array]:
        return [array] if array.ndim == 2 else [array[..., c] for c in range(array.shape[-1])]

    def picture(self, derivative: str | None = None, exposure: float = 0) -> Picture:
        """The image to look at: white is what is brightest on the object; `exposure` makes it brighter, in stops. Or a
        derivative: red where it is above 0, blue below."""
        if derivative is not None:
            if derivative not in self.derivatives:
                raise InvalidInput(
                    f"{derivative} is none of this render's derivatives: "
                    f"{', '.join(self.derivatives) or 'it has none'}"
                )
            return pictures.of_signs(self.derivatives[derivative])
        shown = self.image[self.mask > 0.5]
        shown = shown if shown.size else self.image
        return pictures.of_radiance(self.image, float(np.quantile(shown, 0.99)) / 2.0**exposure)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Writes an OpenEXR file with the layers that `itn render` writes: R, G and B, or Y, its stderr, mask.Y and
        derivatives. A file whose name ends in .png is the picture."""
        name = os.fspath(path)
        if name.lower().endswith(".png"):
            self.picture().write(path)
            return
        if not name.lower().endswith(".exr"):
            raise InvalidInput(f"{name}: its name ends in .exr, or .png for a picture")
        colours = ("Y",) if self.image.ndim == 2 else ("R", "G", "B")
        planes = [("mask.Y", self.mask)]
        for prefix, array in [
            ("", self.image),
            ("stderr.", self.stderr),
            *((f"{d}.", array) for d, array in self.derivatives.items()),
            *((f"stderr.{d}.", array) for d, array in self.derivative_stderr.items()),
        ]:
            planes += [
                (prefix + colour, np.ascontiguousarray(plane)) for colour, plane in zip(colours, self._channels(array))
            ]
        _core.write_exr(name, planes)

    def _repr_png_(self) -> bytes:
        return self.picture().png

    def __repr__(self) -> str:
        height, width = self.mask.shape
        noise = "unknown" if self.spp == 1 else f"{100 * self.noise:.2g} %"
        names = f", derivatives in {', '.join(self.derivatives)}" if self.derivatives else ""
        return (
            f"<itn.Render: {width} x {height} pixels{', in colour' if self.image.ndim == 3 else ''}, "
            f"{self.spp} samples per pixel, noise {noise}, {self.seconds:.2g} s{names}>"
        )


def numbers(name: str, value: Numbers) -> list[float]:
    """One number, or three."""
    try:
        if isinstance(value, (str, bool)):
            raise TypeError
        array = np.asarray(value, dtype=np.float64).ravel()
    except (TypeError, ValueError):
        raise InvalidInput(f"{name} {value!r}: it is a number, or three of red, green and blue") from None
    if array.size not in (1, 3) or not np.isfinite(array).all():
        raise InvalidInput(f"{name} {value!r}: it is a number, or three of red, green and blue")
    return [float(number) for number in array]


def named(name: str, value: Any, kind: Any, what: str) -> Any:
    """A value of a type."""
    if not isinstance(value, kind):
        raise InvalidInput(f"{name} {value!r}: it is {what}")
    return value


def whole(name: str, value: Any, low: int, high: int) -> int:
    """A whole number in a range."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not low <= value <= high:
        raise InvalidInput(f"{name} {value!r}: it is a whole number from {low} to {high}")
    return int(value)


def positive(name: str, value: Any) -> float:
    """A number above 0."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.number)) or not 0 < value < np.inf:
        raise InvalidInput(f"{name} {value!r}: it is a number above 0")
    return float(value)


def processors(threads: int | None) -> int:
    """So many threads as are asked for, or one for each processor that this process may use."""
    return len(os.sched_getaffinity(0)) if threads is None else whole("threads", threads, 1, 1024)


def request_of(
    scene: Scene,
    sigma_t: Numbers | None = None,
    albedo: Numbers | None = None,
    g: Numbers | None = None,
    medium: str | Medium | None = None,
    object_size: float | None = None,
    phase: str | None = None,
) -> tuple[_core.Request, bool]:
    """A request with the medium alone: that which is given, or the scene's. Whether its numbers are in colour."""
    request = _core.Request()
    given = [
        name
        for name, value in (("sigma_t", sigma_t), ("albedo", albedo), ("g", g), ("phase", phase))
        if value is not None
    ]
    if medium is not None and given:
        raise InvalidInput(f"medium and {given[0]}: give a measured medium, or numbers")
    if object_size is not None and medium is None:
        raise InvalidInput("object_size: it goes with medium")
    if g is not None and phase is not None:
        raise InvalidInput("g and phase: a phase function says itself what its mean cosine is")
    if medium is None and not given:
        if not request.take_medium(scene._core):
            raise InvalidInput(
                "sigma_t and albedo are required, or medium, or a medium or material in the scene's object"
            )
        return request, False
    if medium is not None:
        name = medium.name if isinstance(medium, Medium) else named("medium", medium, str, "a name")
        if not name:
            raise InvalidInput("medium '': it is the name of a measured medium; itn.materials() has them")
        request.set_medium(name, 0.0 if object_size is None else positive("object_size", object_size))
        return request, False
    if sigma_t is None or albedo is None:
        raise InvalidInput("sigma_t and albedo are both required where one of the medium's numbers is given")
    kinds = [numbers("sigma_t", sigma_t), numbers("albedo", albedo), [] if g is None else numbers("g", g)]
    request.set_material(*kinds)
    request.set_phase("" if phase is None else named("phase", phase, str, "the text of a phase function"))
    return request, any(len(kind) == 3 for kind in kinds)


def render(
    scene: Scene | Mapping[str, Any] | str | os.PathLike[str],
    *,
    sigma_t: Numbers | None = None,
    albedo: Numbers | None = None,
    g: Numbers | None = None,
    medium: str | Medium | None = None,
    object_size: float | None = None,
    phase: str | None = None,
    spp: int | None = None,
    noise: float | None = None,
    time: float | None = None,
    seed: int = 0,
    derivatives: str | Sequence[str] = (),
    estimates: int = 1,
    pilot_spp: int = 0,
    values: Mapping[str, float] | None = None,
    resolution: int | Sequence[int] | None = None,
    colour: bool | None = None,
    pixels: str = "all",
    tracer: str = "wavefront",
    threads: int | None = None,
    workers: Workers | Asked | None = None,
    progress: Callable[[float], Any] | None = None,
    stop: _core.Stop | None = None,
) -> Render:
    """Renders an image of the scene and derivatives of it.

    scene: what itn.load or itn.scene returns, the path of a scene file, or a dictionary as itn.scene takes.
    sigma_t, albedo, g: the medium: extinction in 1/mm, single-scattering albedo, mean cosine (default 0); three
        numbers of one of them, of red, green and blue, make an image in colour. Default: the scene's own medium.
    medium, object_size: instead, a measured medium (itn.materials), in an object that stands for one whose
        longest side is object_size, in mm (default: the object's own).
    phase: instead of g, the text of a phase function: "two_term { g_1: 0.8 g_2: -0.3 weight: 0.9 }".
    spp: samples per pixel, default 64. With noise or time, the most.
    noise: renders until Render.noise is at most this.
    time: renders for about so many seconds.
    seed: of the random numbers; the same seed gives the same bits.
    derivatives: names of numbers to differentiate in: "sigma_t", "albedo", "g", "sigma_a", ..., and those of
        Scene.parameters.
    estimates: how many independent estimates there are, which tell errors of derivatives.
    pilot_spp: samples per pixel of a pilot, which quietens derivatives in sigma_t and g.
    values: numbers of the scene that are others than it says, by name; none of the medium.
    resolution: pixels of the image, instead of the film's: of a square, or (width, height).
    colour: an image in colour, or not, whatever the film says.
    pixels: "all", or those that see the "object"; others are 0.
    tracer: "wavefront", or "reference", plain path tracing.
    threads: how many, of this process; default: one for each processor.
    workers: render workers (docs/operations.md) that render instead of this process, as "host:50051" or "unix:/run/w";
        the variables ITN_TLS_CA, ITN_TOKEN_FILE and so on secure the connection. The program itn, which asks them,
        is kept for the next call.
    progress: called with the part that is done, in [0, 1], now and then.
    stop: an itn.Stop, whose request() from another thread ends this with Cancelled.

    What may be wrong with the image is said by warnings. Raises InvalidInput, FileError, LimitExceeded. Ctrl-C
    raises KeyboardInterrupt at once.
    """
    scene = as_scene(scene)
    if resolution is not None:
        sides = (
            [resolution]
            if isinstance(resolution, (int, np.integer))
            else list(named("resolution", resolution, Sequence, "a number of pixels, or (width, height)"))
        )
        if isinstance(resolution, str) or len(sides) not in (1, 2):
            raise InvalidInput(f"resolution {resolution!r}: it is a number of pixels, or (width, height)")
        scene = scene.resized(*sides)
    request, in_colour = request_of(scene, sigma_t, albedo, g, medium, object_size, phase)
    if in_colour and colour is False:
        raise InvalidInput("colour=False and three numbers of red, green and blue: they are of an image in colour")
    if colour is False and scene._core.is_in_colour():
        scene = scene.coloured(False)
    in_colour = in_colour or scene._core.is_in_colour()
    request.set_colour(in_colour if colour is None else bool(colour))
    goal = noise is not None or time is not None
    if goal and pilot_spp:
        raise InvalidInput("noise or time, and pilot_spp: a pilot spreads a number of samples that is known")
    spp = whole("spp", spp if spp is not None else _core.MAX_SPP if goal else 64, 1, _core.MAX_SPP)
    request.set_samples(
        spp,
        whole("seed", seed, 0, MAX_SEED),
        whole("estimates", estimates, 1, _core.MAX_ESTIMATES),
        whole("pilot_spp", pilot_spp, 0, _core.MAX_PILOT_SPP),
    )
    request.set_goal(
        0.0 if noise is None else positive("noise", noise), 0.0 if time is None else positive("time", time)
    )
    names = [derivatives] if isinstance(derivatives, str) else [str(name) for name in derivatives or ()]
    for name in names:
        _core.is_of_medium(name)
    request.set_derivatives(names)
    others = {}
    for name, value in named("values", values or {}, Mapping, "a dictionary of numbers by name").items():
        if _core.is_of_medium(name):
            raise InvalidInput(f"values: {name} is of the medium, which sigma_t, albedo, g and phase say")
        if isinstance(value, (str, bool)) or np.size(value) != 1:
            raise InvalidInput(f"values: {name} is {value!r}; it is a number")
        others[name] = float(np.asarray(value, dtype=np.float64).ravel()[0])
    request.set_values(list(others.items()))
    request.set_pixels(named("pixels", pixels, str, "'all' or 'object'"))
    request.set_tracer(named("tracer", tracer, str, "'wavefront' or 'reference'"))
    request.set_threads(processors(threads))
    if stop is not None:
        named("stop", stop, _core.Stop, "an itn.Stop")
    with asked(workers) as by:
        done = _core.render(scene._core, request, by.core, stop, by.progress(progress))
    if done.interrupted:
        raise Cancelled("cancelled")
    for remark in [*done.remarks, *_core.take_messages()]:
        warn(remark)
    return _render_of(done, names)


def _render_of(done: _core.Image, names: list[str]) -> Render:
    image = done.radiance()
    several = done.estimates > 1

    def stacked(of_estimate: Callable[[int], Array], mean: Array) -> Array:
        return np.stack([of_estimate(k) for k in range(done.estimates)]) if several else mean[np.newaxis]

    derivatives = {name: done.derivative(d) for d, name in enumerate(names)}
    return Render(
        image=image,
        stderr=done.standard_error(),
        mask=done.mask(),
        derivatives=derivatives,
        derivative_stderr={name: done.derivative_error(d) for d, name in enumerate(names)} if several else {},
        estimates=stacked(done.radiance_of_estimate, image),
        derivative_estimates={
            name: stacked(partial(done.derivative_of_estimate, d), derivatives[name]) for d, name in enumerate(names)
        },
        spp=done.spp,
        seconds=done.seconds,
        materials=done.materials,
        counters=dict(zip(_COUNTERS, done.counters)),
    )


def in_threads(work: Iterable[Callable[[_core.Stop], T]], at_a_time: int) -> Iterator[tuple[int, T | BaseException]]:
    """Does work in so many threads, and yields (number, what it returned or raised) as it is done. Work is taken as it
    is needed. What is under way when nobody takes further answers is stopped."""
    stop = _core.Stop()
    waiting: queue.SimpleQueue[tuple[int, Callable[[_core.Stop], T]] | None] = queue.SimpleQueue()
    done: queue.SimpleQueue[tuple[int, T | BaseException]] = queue.SimpleQueue()

    def serve() -> None:
        while (job := waiting.get()) is not None:
            try:
                done.put((job[0], job[1](stop)))
            except BaseException as error:
                done.put((job[0], error))

    # Daemons, so that nobody waits for them as Python ends.
    threads: list[threading.Thread] = []
    ahead = enumerate(work)
    under_way = 0

    def submit() -> None:
        nonlocal under_way
        while under_way <= at_a_time and (job := next(ahead, None)) is not None:
            waiting.put(job)
            under_way += 1
            if len(threads) < at_a_time:
                threads.append(threading.Thread(target=serve, daemon=True))
                threads[-1].start()

    try:
        submit()
        while under_way:
            try:
                # In short turns, as a signal that comes just before it waits does not wake it.
                answer = done.get(timeout=0.02)
            except queue.Empty:
                continue
            under_way -= 1
            yield answer
            submit()
    finally:
        stop.request()
        for _ in threads:
            waiting.put(None)


def render_many(requests: Iterable[Mapping[str, Any]], *, threads: int | None = None) -> Iterator[tuple[int, Render]]:
    """Renders many images at the same time, each with one thread, and yields (number, Render) as they are done.

    requests: the arguments of itn.render, `scene` among them, as a dictionary for each image. They are taken as
        they are needed, so that there may be any number of them.
    threads: how many images at a time; default: one for each processor.

    Raises what itn.render raises, for the first that fails, with its number. What is under way then, or where nobody
    takes further images, is cancelled.
    """

    def work(number: int, request: Any) -> Callable[[_core.Stop], Render]:
        if not isinstance(request, Mapping) or "scene" not in request:
            raise InvalidInput(f"request {number}: it is a dictionary of the arguments of itn.render, with a scene")
        return lambda stop: render(**{"threads": 1, "stop": stop, **request})

    if isinstance(requests, Mapping):
        raise InvalidInput("requests: they are a list of dictionaries, one for each image")
    for number, done in in_threads((work(i, request) for i, request in enumerate(requests)), processors(threads)):
        if isinstance(done, Error):
            raise type(done)(f"request {number}: {done}") from done
        if isinstance(done, BaseException):
            raise done
        yield number, done
