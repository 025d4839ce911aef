"""Media that others have measured."""

from __future__ import annotations

from dataclasses import dataclass

from . import _core


@dataclass(frozen=True)
class Medium:
    """A measured medium: numbers of red, green and blue."""

    name: str  #: as `medium` of itn.render takes it
    sigma_t: tuple[float, float, float]  #: extinction, in 1/mm
    albedo: tuple[float, float, float]  #: single-scattering albedo
    g: tuple[float, float, float]  #: mean cosine of scattering
    index: float  #: of refraction
    source: str  #: who measured it


def materials() -> dict[str, Medium]:
    """The measured media by name."""
    media = {}
    for name, source, index, channels in _core.measured_media():
        sigma_t, albedo, g = zip(*channels)
        media[name] = Medium(name, sigma_t, albedo, g, index, source)
    return media
