"""Images of two renderers, by the means of their tiles."""

import numpy as np
from welch import largest_by_chance, z_of_difference

TILE = 8  # side, in pixels
FAMILY_WISE = 1e-3  # probability that a comparison fails by chance


def tiles(image):
    """Means of the tiles, and of all pixels, of each channel."""
    channels = np.atleast_3d(image).astype(float)
    height, width = (size // TILE * TILE for size in channels.shape[:2])
    cut = channels[:height, :width].reshape(height // TILE, TILE, width // TILE, TILE, -1)
    return np.append(cut.mean(axis=(1, 3)).ravel(), channels.mean(axis=(0, 1)))


def agree(name, ours, theirs, channels=1, rounding=0.0, alike=1e-5):
    """Whether runs x tiles of itn and of Mitsuba do, by z-tests with Sidak's correction; prints how far.

    Tiles whose standard deviations are at most the part `rounding` of the mean have no noise, as they show one light and
    nothing else: they differ by at most the part `alike` of the image's mean.
    """
    a, b = np.array(ours), np.array(theirs)
    noisy = (a.std(axis=0) > rounding * a.mean()) | (b.std(axis=0) > rounding * a.mean())
    same = bool(np.all(np.abs(a[0] - b[0])[~noisy] <= alike * a[0, -1]))
    scores = z_of_difference(b[:, noisy], a[:, noisy])
    limit = largest_by_chance(len(scores), FAMILY_WISE)
    means = [runs[:, -channels:].mean(axis=0) for runs in (a, b)]
    error = np.hypot(*(runs[:, -channels:].std(axis=0, ddof=1) / np.sqrt(len(runs)) for runs in (a, b)))
    print(
        f"{name}: means of itn {np.round(means[0], 6)}, of Mitsuba {np.round(means[1], 6)}; difference "
        f"{np.round(100 * (means[1] / means[0] - 1), 3)} % +- {np.round(100 * error / means[0], 3)} %; of {len(scores)} "
        f"comparisons, the largest |z| is {np.abs(scores).max():.2f}; chance alone exceeds {limit:.2f} once in "
        f"{1 / FAMILY_WISE:.0f} runs" + ("" if same else "; tiles without noise differ"),
        flush=True,
    )
    return same and bool(np.all(np.abs(scores) < limit))  # false for NaN
