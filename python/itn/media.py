"""Media that others have measured."""
from __future__ import annotations

from typing import NamedTuple

from . import _core


class Medium(NamedTuple):
    """A measured medium: numbers of red, green and blue."""

    sigma_t: tuple[float, float, float]  #: extinction, in 1/mm
    albedo: tuple[float, float, float]  #: single-scattering albedo
    g: tuple[float, float, float]  #: mean cosine of scattering
    index: float  #: of refraction
    source: str  #: who measured it


def materials() -> dict[str, Medium]:
    """The measured media by name, as `medium` of itn.render takes them."""
    return {name: Medium(*(tuple(kind) for kind in zip(*channels)), index, source)
            for name, source, index, channels in _core.measured_media()}
