"""Translucent materials: renders with derivatives, and materials from images.

import itn
scene = itn.load("cube.textproto")
r = itn.render(scene, sigma_t=60, albedo=.8, g=.3, spp=256, derivatives=["sigma_t"])
r.image, r.stderr, r.derivatives["sigma_t"]
"""

import atexit
from pkgutil import extend_path

# Stubs that protoc makes of proto/ are the package itn.v1, which may lie elsewhere.
__path__ = extend_path(__path__, __name__)

from . import _core
from .analysis import Answer, Prediction, Refinement, fit, predict, predict_many, refine
from ._core import VERSION as __version__
from ._core import Stop, derivative_names
from .datasets import Dataset
from .errors import Cancelled, Error, FileError, InvalidInput, LimitExceeded, Unavailable
from .media import Medium, materials
from .pictures import Picture, row
from .rendering import Render, render, render_many
from .scene import Number, Scene, load, scene

atexit.register(_core.end_renders)

__all__ = [
    "Answer",
    "Cancelled",
    "Dataset",
    "Error",
    "FileError",
    "InvalidInput",
    "LimitExceeded",
    "Medium",
    "Number",
    "Picture",
    "Prediction",
    "Refinement",
    "Render",
    "Scene",
    "Stop",
    "Unavailable",
    "__version__",
    "derivative_names",
    "fit",
    "load",
    "materials",
    "predict",
    "predict_many",
    "refine",
    "render",
    "render_many",
    "row",
    "scene",
]
