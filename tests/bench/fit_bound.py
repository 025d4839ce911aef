#!/usr/bin/env python3
"""How well any unbiased estimate could find the materials of fit_bench.py's photographs.

  fit_bound.py --itn build/release/bin/itn FOLDER-OF-A-CASE ...

Prints the Cramer-Rao bound of the standard deviations of ln sigma_s', ln sigma_a and the diffuse albedo at the
truth, and by it the errors of itn fit and the deviations that it tells. Unknown are with the material: exposure
(within 3 % of a card, else anything), index, roughness, place of the flash, and what the fit allows for of the pose and of
another g (disturbance.0 and so on of photograph.exr), within what the fit is told.

The information is the mean of J_a' C^-1 J_b over pairs of independent renders a and b, J the derivative images: with
the same render twice its noise would count as information. C is the covariance of the photograph: noise of sensor
and of the render that it was made of, and what a shape 0.2 % off changes, 1.8 % of the radiance as the fit allows for, alike
over a 15th of the object as a Gaussian process is; a second bound is without that, of a shape that is known exactly.
Needs what fit_bench.py needs.
"""
import argparse
import json
import math
import pathlib
import re

import numpy as np

import fit_bench

SHAPE = 0.018  # of the radiance
ESTIMATES = 4
NAMES = ["ln sigma_s'", "ln sigma_a", "diffuse albedo"]


def number_of(folder):
    return int(re.match(r"[a-z]+(\d+)", folder.name)[1])


def truth_of(folder, seed):
    """sigma_s', sigma_a and g, as fit_bench.py chose them."""
    return *fit_bench.material_of(number_of(folder)), fit_bench.random_of(number_of(folder), seed)[1]


def scene_of(folder):
    """The truth as the fit sees it: its part of the frame, its pixels, and a flash that has derivatives."""
    truth, fitted = (folder / "truth.textproto").read_text(), (folder / "fit" / "scene.textproto").read_text()
    crop = re.search(r"crop {[^}]*}", fitted)
    film = re.search(r"film {[^}]*}", fitted)[0]
    truth = re.sub(r"film {[^}]*}", film, truth)
    if crop:
        truth = re.sub(r"(camera {.*fov_degrees: \S+)", lambda m: f"{m[1]} {crop[0]}", truth)
    # Radiance of a ball of 1 mm as bright from afar as the point.
    truth = re.sub(r"point { position ({[^}]*}) intensity: (\S+) }",
                   lambda m: f"sphere {{ center {m[1]} radius: 1 radiance: {float(m[2]) / math.pi} }}", truth)
    file = folder / "bound.textproto"
    file.write_text(truth)
    return file


def unknowns_of(setup):
    """What is found with the material: name, and within what it is known."""
    free = math.inf
    of_light = ({"light[0].sphere.center.x": 5, "light[0].sphere.center.y": 5} if fit_bench.by_flash(setup) else {})
    return {"rough_dielectric.index": 0.03, "rough_dielectric.roughness": free, **of_light}


def estimates_of(folder, scene, truth, names, spp, itn):
    """Radiance, by name the derivatives' standard errors, and by estimate derivative images."""
    file = folder / "bound.exr"
    if not file.exists():
        sigma_s, sigma_a, g = truth
        total = sigma_a + sigma_s / (1 - g)
        fit_bench.run(itn, "render", scene, "-o", file, "--sigma-t", total, "--albedo", 1 - sigma_a / total, "--g", g,
                      "--derivatives", ",".join(names), "--estimates", ESTIMATES, "--spp", spp, "--pilot-spp", 4,
                      "--pixels", "object", "--seed", 4711 + number_of(folder))
    layers = fit_bench.read(file)
    errors = [layers[f"stderr.{name}.Y"] for name in names]
    return layers["Y"], errors, [[layers[f"estimate{k}.{name}.Y"] for name in names] for k in range(ESTIMATES)]


def noise_of(folder, radiance, counts, setup):
    """Variance of what a pixel of the fit averages, as a part of the squared radiance."""
    truth = fit_bench.read(folder / "truth.exr")
    on_object = truth["mask.Y"] > 0.5
    scale = fit_bench.brightness(truth["Y"], truth["mask.Y"], setup)
    crop = re.search(r"left: (\S+)[^}]*right: (\S+)", (folder / "fit" / "scene.textproto").read_text())
    part = float(crop[2]) - float(crop[1]) if crop else 1
    averaged = (part * fit_bench.SIDE / len(radiance)) ** 2
    x = scale * radiance[counts] * truth["Y"][on_object].mean() / radiance[counts].mean()
    of_render = np.mean((truth["stderr.Y"][on_object] / truth["Y"][on_object].mean()) ** 2)
    return (fit_bench.sensor_variance(x) / x ** 2 + of_render) / max(1, averaged)


def by_shape(counts):
    """Covariance of neighbours, where the shape is off, as a part of the squared radiance."""
    y, x = np.nonzero(counts)
    length = max(np.ptp(x), np.ptp(y)) / 15
    far = (x[:, None] - x) ** 2 + (y[:, None] - y) ** 2
    return SHAPE ** 2 * np.exp(-far / (2 * length ** 2))


def smoothed(plane, errors, radiance, counts):
    """By a binomial filter over pixels that count, twice, as a part of the radiance: derivatives hardly change from one
    pixel to the next. What is far noisier than the others, as some derivatives in the index are, is left out."""
    def filtered(image):
        for axis in (0, 1):
            image = (np.roll(image, 1, axis) + 2 * image + np.roll(image, -1, axis)) / 4
        return np.where(counts, image, 0)
    relative = np.where(counts, errors / np.maximum(radiance, 1e-30), 0)
    weights = np.where(counts & (relative < 2.5 * np.median(relative[counts])), 1.0, 0)
    plane = np.where(counts, plane / np.maximum(radiance, 1e-30), 0)
    for _ in range(2):
        plane, weights = filtered(plane * weights), filtered(weights)
        plane = plane / np.maximum(weights, 1e-9)
    return plane[counts]


def bound_of(jacobians, covariance, prior):
    """Covariance that no unbiased estimate is below."""
    weighted = [np.linalg.solve(covariance, j) for j in jacobians]
    pairs = [(a, b) for a in range(len(jacobians)) for b in range(len(jacobians)) if a != b]
    information = sum(jacobians[a].T @ weighted[b] for a, b in pairs) / len(pairs)
    return np.linalg.inv((information + information.T) / 2 + np.diag(prior))


def slopes_of_albedo(sigma_s, sigma_a):
    """Of the diffuse albedo, by ln sigma_s' and ln sigma_a."""
    def at(s, a):
        return fit_bench.diffuse_albedo(sigma_s * math.exp(s), sigma_a * math.exp(a))
    step = 1e-4
    return np.array([at(step, 0) - at(-step, 0), at(0, step) - at(0, -step)]) / (2 * step)


def measure(folder, options):
    """By name, in the order of NAMES: bound, bound of an exact shape, error, and deviation that is told."""
    setup = re.match("[a-z]+", folder.name)[0]
    sigma_s, sigma_a, g = truth = truth_of(folder, options.seed)
    scene = scene_of(folder)
    unknowns = unknowns_of(setup)
    names = ["sigma_s_reduced", "sigma_a", *unknowns]
    radiance, standard_errors, estimates = estimates_of(folder, scene, truth, names, options.spp, options.itn)
    compared = fit_bench.read(folder / "fit" / "photograph.exr")
    counts = (compared["mask.Y"] > 0.5) & (radiance > 0)
    of_pose = [compared[name][counts] for name in sorted(compared) if name.startswith("disturbance.")]
    jacobians = []
    for planes in estimates:
        columns = [smoothed(*both, radiance, counts) for both in zip(planes, standard_errors)]
        columns[0] *= sigma_s
        columns[1] *= sigma_a
        jacobians.append(np.stack([*columns, np.ones(counts.sum()), *of_pose], axis=1))
    card = math.inf if setup == "plain" else 0.03 if fit_bench.by_flash(setup) else 0.06
    within = [math.inf, math.inf, *unknowns.values(), card] + [1] * len(of_pose)
    prior = np.array([1 / w ** 2 for w in within])
    noise = np.diag(noise_of(folder, radiance, counts, setup))
    slopes = slopes_of_albedo(sigma_s, sigma_a)
    found = json.loads((folder / "result.json").read_text())["results"][0]
    deviations = []
    for covariance in (noise + by_shape(counts), noise):
        bound = bound_of(jacobians, covariance, prior)[:2, :2]
        variances = (bound[0, 0], bound[1, 1], slopes @ bound @ slopes)
        # Below 0 is what noise of the derivatives makes of too few samples.
        deviations.append([math.sqrt(v) if v > 0 else math.nan for v in variances])
    s, a = found["sigma_s_reduced"], found["sigma_a"]
    errors = [math.log(s["value"] / sigma_s), math.log(a["value"] / sigma_a),
              fit_bench.diffuse_albedo(s["value"], a["value"]) - fit_bench.diffuse_albedo(sigma_s, sigma_a)]
    told = [s["standard_deviation"] / s["value"], a["standard_deviation"] / a["value"],
            found["diffuse_albedo"]["standard_deviation"]]
    return list(zip(*deviations, errors, told))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--itn", required=True, type=pathlib.Path)
    parser.add_argument("--spp", type=int, default=8192)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("folders", nargs="+", type=pathlib.Path)
    options = parser.parse_args()
    cases = []
    for folder in options.folders:
        cases.append(measure(folder, options))
        print(f"{folder.name:12} " + "  ".join(
            f"{name} bound {bound:.3f} exact {exact:.3f} error {error:+.3f} told {told:.3f}"
            for name, (bound, exact, error, told) in zip(NAMES, cases[-1])), flush=True)
    cases = np.array(cases)
    for i, name in enumerate(NAMES):
        bound, exact, error, told = cases[:, i].T
        print(f"{name}: medians of the bound {np.nanmedian(bound):.3f}, of an exact shape {np.nanmedian(exact):.3f}, error "
              f"{np.nanmedian(abs(error)):.3f}, error by bound {np.nanmedian(abs(error) / bound):.2f} (.67 of the best estimate), "
              f"told by bound {np.nanmedian(told / bound):.2f}")


if __name__ == "__main__":
    main()
