"""Renders that PyTorch differentiates through.

    import itn, itn.torch, torch
    sigma_t = torch.tensor(20.0, requires_grad=True)
    image = itn.torch.render(scene, {"sigma_t": sigma_t, "albedo": 0.8, "g": 0.3}, spp=32)
    (image - target).square().mean().backward()

No other module of itn imports PyTorch.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import torch
from torch.autograd.function import once_differentiable

from . import _core
from .errors import InvalidInput
from .rendering import MAX_SEED, in_threads, processors, request_of, whole
from .rendering import render as _render
from .scene import Scene, as_scene
from .workers import Asked, Workers, asked

_MEDIUM = ("sigma_t", "albedo", "g")
# Images that workers are asked for at a time.
_MOST_ASKED = 64
# What is added to the seed of an image for that of its gradient, whose samples are to be others.
_OTHER_SAMPLES = 0x9E3779B97F4A7C15

_T = TypeVar("_T")


@dataclass(frozen=True)
class _Means:
    """What renders an image: workers, or threads of this process."""

    threads: int
    workers: Asked
    stop: _core.Stop


@dataclass(frozen=True)
class _Renderer:
    threads: int
    workers: Workers | None

    def each(self, count: int, work: Callable[[int, _Means], _T]) -> list[_T]:
        """work(number, means) of each; several at the same time, with a thread each."""
        with asked(self.workers) as by:
            if count == 1:
                return [work(0, _Means(self.threads, by, _core.Stop()))]

            def one(number: int, stop: _core.Stop) -> _T:
                return work(number, _Means(1, by, stop))

            done: dict[int, _T] = {}
            at_a_time = self.threads if by.core is None else min(count, _MOST_ASKED)
            for number, answer in in_threads((partial(one, i) for i in range(count)), at_a_time):
                if isinstance(answer, BaseException):
                    raise answer
                done[number] = answer
            return [done[i] for i in range(count)]


@dataclass(frozen=True)
class _Job:
    """An image of a batch; its numbers are tensors, which come apart from it."""

    scene: Scene
    names: tuple[str, ...]
    in_colour: bool
    spp: int
    spp_grad: int
    seed: int
    seed_grad: int
    phase: str | None

    def values(self, tensors: Sequence[torch.Tensor]) -> dict[str, npt.NDArray[Any]]:
        return {
            name: tensor.detach().to("cpu", torch.float64).reshape(-1).numpy()
            for name, tensor in zip(self.names, tensors)
        }

    def of_scene(self, values: Mapping[str, npt.NDArray[Any]]) -> dict[str, float]:
        return {name: float(value[0]) for name, value in values.items() if name not in _MEDIUM}

    def image(self, tensors: Sequence[torch.Tensor], means: _Means) -> npt.NDArray[Any]:
        values = self.values(tensors)
        medium: dict[str, Any] = {name: values[name] for name in _MEDIUM if name in values}
        if self.phase is not None:
            medium["phase"] = self.phase
        return _render(
            self.scene,
            **medium,
            values=self.of_scene(values),
            spp=self.spp,
            seed=self.seed,
            colour=self.in_colour,
            threads=means.threads,
            workers=means.workers,
            stop=means.stop,
        ).image

    def gradient(
        self,
        tensors: Sequence[torch.Tensor],
        wanted: Sequence[int],
        weights: npt.NDArray[Any],
        means: _Means,
    ) -> npt.NDArray[Any]:
        """Of the sum of weights times radiances, in the wanted numbers: channels x wanted."""
        if not np.isfinite(weights).all():
            raise InvalidInput("the loss has a gradient in the image that is not finite")
        values = self.values(tensors)
        request = _core.Request()
        request.set_material(*(values[name].tolist() if name in values else [] for name in _MEDIUM))
        request.set_phase(self.phase or "")
        request.set_colour(self.in_colour)
        request.set_samples(self.spp_grad, self.seed_grad, 1, 0)
        request.set_derivatives([self.names[i] for i in wanted])
        request.set_values(list(self.of_scene(values).items()))
        request.set_threads(means.threads)
        channels = np.moveaxis(np.atleast_3d(weights), -1, 0)
        planes = [np.ascontiguousarray(plane, dtype=np.float32) for plane in channels]
        by = means.workers
        return np.array(
            _core.gradient(self.scene._core, request, by.core, planes, means.stop, by.progress(None)), dtype=np.float64
        )


class _Renders(torch.autograd.Function):
    """Images of the jobs, whose tensors come one job after the other."""

    @staticmethod
    def forward(jobs: Sequence[_Job], renderer: _Renderer, *tensors: torch.Tensor) -> torch.Tensor:
        of_job = _by_job(jobs, tensors)
        images = renderer.each(len(jobs), lambda i, means: jobs[i].image(of_job[i], means))
        return torch.from_numpy(np.stack(images) if len(images) > 1 else images[0][np.newaxis])

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: torch.Tensor) -> None:
        ctx.jobs, ctx.renderer, *tensors = inputs
        ctx.save_for_backward(*tensors)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad: torch.Tensor) -> tuple[Any, ...]:
        jobs, of_job = ctx.jobs, _by_job(ctx.jobs, ctx.saved_tensors)
        needed = _by_job(jobs, ctx.needs_input_grad[2:])
        wanted = [[i for i, need in enumerate(of_one) if need] for of_one in needed]
        weights = grad.detach().to("cpu", torch.float32).numpy()
        sums = ctx.renderer.each(
            len(jobs),
            lambda i, means: (
                jobs[i].gradient(of_job[i], wanted[i], weights[i], means) if wanted[i] else np.empty((1, 0))
            ),
        )
        grads: list[torch.Tensor | None] = []
        for i, tensors in enumerate(of_job):
            for j, tensor in enumerate(tensors):
                if j not in wanted[i]:
                    grads.append(None)
                    continue
                by_channel = sums[i][:, wanted[i].index(j)]
                total = by_channel if tensor.numel() == 3 else by_channel.sum()
                grads.append(torch.as_tensor(total, dtype=tensor.dtype, device=tensor.device).reshape(tensor.shape))
        return None, None, *grads


def _by_job(jobs: Sequence[_Job], held: Sequence[_T]) -> list[Sequence[_T]]:
    parts, first = [], 0
    for job in jobs:
        parts.append(held[first : first + len(job.names)])
        first += len(job.names)
    return parts


if not hasattr(torch.autograd.Function, "setup_context"):  # PyTorch before 2.0

    class _RendersWithContext(_Renders):
        @staticmethod
        def forward(ctx: Any, *inputs: Any) -> torch.Tensor:  # type: ignore[override]
            images = _Renders.forward(*inputs)
            _Renders.setup_context(ctx, inputs, images)
            return images

    _apply = _RendersWithContext.apply
else:
    _apply = _Renders.apply


def _job(
    scene: Any,
    parameters: Mapping[str, Any],
    *,
    spp: int,
    spp_grad: int | None,
    seed: int,
    seed_grad: int | None,
    phase: str | None,
    colour: bool | None,
) -> tuple[_Job, list[torch.Tensor]]:
    scene = as_scene(scene)
    if colour is False:
        scene = scene.coloured(False)
    if not set(_MEDIUM) & parameters.keys() and phase is None:
        request, _ = request_of(scene)
        request.set_colour(scene._core.is_in_colour() if colour is None else bool(colour))
        kinds = zip(_MEDIUM, zip(*_core.materials_of(scene._core, request)))
        parameters = {**{name: kind if len(set(kind)) > 1 else kind[0] for name, kind in kinds}, **parameters}
    tensors = []
    for name, value in parameters.items():
        of_medium = _core.is_of_medium(name)
        if of_medium and name not in _MEDIUM:
            raise InvalidInput(f"{name}: the numbers of the medium are here sigma_t, albedo and g")
        tensor = value if isinstance(value, torch.Tensor) else torch.as_tensor(value, dtype=torch.float64)
        if tensor.numel() != 1 and not (tensor.numel() == 3 and name in ("sigma_t", "albedo")):
            several = ", or three of red, green and blue" if name in ("sigma_t", "albedo") else ""
            raise InvalidInput(f"{name}: it is one number{several}, not a tensor of the shape {tuple(tensor.shape)}")
        tensors.append(tensor)
    for name in ("sigma_t", "albedo"):
        if name not in parameters:
            raise InvalidInput(f"parameters: sigma_t and albedo are required; {name} is missing")
    in_colour = any(tensor.numel() == 3 for tensor in tensors) or scene._core.is_in_colour()
    spp, seed = whole("spp", spp, 1, _core.MAX_SPP), whole("seed", seed, 0, MAX_SEED)
    return (
        _Job(
            scene=scene,
            names=tuple(parameters),
            in_colour=in_colour if colour is None else bool(colour),
            spp=spp,
            spp_grad=spp if spp_grad is None else whole("spp_grad", spp_grad, 1, _core.MAX_SPP),
            seed=seed,
            seed_grad=(
                ((seed + _OTHER_SAMPLES) & MAX_SEED)
                if seed_grad is None
                else whole("seed_grad", seed_grad, 0, MAX_SEED)
            ),
            phase=phase,
        ),
        tensors,
    )


def render(
    scene: Any,
    parameters: Mapping[str, Any],
    *,
    spp: int = 64,
    spp_grad: int | None = None,
    seed: int = 0,
    seed_grad: int | None = None,
    phase: str | None = None,
    colour: bool | None = None,
    threads: int | None = None,
    workers: Workers | None = None,
) -> torch.Tensor:
    """Renders an image, (height, width) or in colour (height, width, 3), float32, on the CPU.

    scene: what itn.load or itn.scene returns, the path of a scene file, or a dictionary.
    parameters: tensors or numbers by name: sigma_t (1/mm) and albedo, g unless there is a phase (default 0), and
        any of Scene.parameters. Without one of the medium, that of the scene's object. sigma_t and albedo may have
        three numbers, of red, green and blue; all others have one.
    spp, seed: of the image. Take another seed in each step of an optimisation.
    spp_grad, seed_grad: of the gradient. Default: as many samples as the image's, and others, so that the gradient
        of a loss that is quadratic in the image is right on average.
    phase, colour, threads, workers: as of itn.render.

    The gradient takes about as long as the image, however many parameters there are, and in colour three times as
    long. It has no derivatives of its own. Raises what itn.render raises.
    """
    job, tensors = _job(
        scene, parameters, spp=spp, spp_grad=spp_grad, seed=seed, seed_grad=seed_grad, phase=phase, colour=colour
    )
    return _apply((job,), _Renderer(processors(threads), workers), *tensors)[0]


def render_batch(
    scenes: Any,
    parameters: Mapping[str, Any],
    *,
    spp: int = 64,
    spp_grad: int | None = None,
    seed: int = 0,
    phase: str | None = None,
    colour: bool | None = None,
    threads: int | None = None,
    workers: Workers | None = None,
) -> torch.Tensor:
    """Renders images at the same time, (batch, height, width) or (batch, height, width, 3).

    scenes: one for all images, or a sequence with one for each, all of one size.
    parameters: as of render(). Tensors have a first dimension of the length of the batch, numbers are for all.
    seed: of the first image; those of the others follow.
    spp, spp_grad, phase, colour, threads, workers: as of render(). Workers are asked for 64 images at a time.
    """
    one_scene = isinstance(scenes, (Scene, Mapping, str, os.PathLike))
    lengths = set() if one_scene else {len(scenes)}
    lengths |= {len(v) for v in parameters.values() if isinstance(v, torch.Tensor) and v.dim() > 0}
    if len(lengths) != 1 or 0 in lengths:
        raise InvalidInput(
            "scenes and parameters: they say how many images there are, all the same; not "
            + (" and ".join(map(str, sorted(lengths))) or "nothing")
        )
    if one_scene:
        scenes = as_scene(scenes)
    jobs, tensors = [], []
    for i in range(lengths.pop()):
        numbers = {name: v[i] if isinstance(v, torch.Tensor) and v.dim() > 0 else v for name, v in parameters.items()}
        job, of_job = _job(
            scenes if one_scene else scenes[i],
            numbers,
            spp=spp,
            spp_grad=spp_grad,
            seed=(seed + i) & MAX_SEED,
            seed_grad=None,
            phase=phase,
            colour=colour,
        )
        jobs.append(job)
        tensors += of_job
    sizes = {(job.scene.width, job.scene.height, job.in_colour) for job in jobs}
    if len(sizes) > 1:
        raise InvalidInput("scenes: their images are of several sizes, or in colour and not")
    return _apply(tuple(jobs), _Renderer(processors(threads), workers), *tensors)
