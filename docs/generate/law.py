#!/usr/bin/env python3
"""Trains networks on parts of a dataset, and fits how their errors fall with the number of images.

  law.py train DATASET RUNS [--images N ...] [--base-channels N ...] [--seeds N] [--steps N] [--preset NAME]
               [--test DATASET] [--split SPLIT]
  law.py fit LAW.csv [--picture FILE.png]

`train` makes a run in the folder RUNS for each size, width and seed, continues those that were stopped, evaluates the
best step of each on the images of the test, and writes what it has to RUNS/law.csv. `fit` reads such a file (Debian:
python3-numpy; the picture python3-matplotlib). The programs are in the folder ITN_BIN (default: build/release/bin).

Errors are mean absolute errors over that of the best constant, and the mean of minus the log-likelihood of the truth.
The law is L = floor + c N^-alpha for N images."""
import argparse
import csv
import json
import math
import os
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
ITN = pathlib.Path(os.environ.get("ITN_BIN", ROOT / "build/release/bin")) / "itn"
ERRORS = ["sigma_t", "albedo", "g"]
KEYS = ["base_channels", "images", "seed"]
COLUMNS = KEYS + [*ERRORS, "diffuse_albedo", "ln_diffusion_length", "log_likelihood", "joint_coverage"]


def evaluated(run, dataset, split):
    answer = subprocess.run([ITN, "evaluate", run / "best.itn", "--dataset", dataset, "--split", split, "--json",
                             "-q"], check=True, capture_output=True, text=True)
    row = json.loads(answer.stdout)["rows"][0]
    return {**{name: row["relative_absolute"][name] for name in ERRORS},
            **{name: row[name] for name in COLUMNS[len(KEYS) + len(ERRORS):]}}


def train(arguments):
    rows = []
    for width in arguments.base_channels:
        for images in arguments.images:
            for seed in range(arguments.seeds):
                run = arguments.runs / f"{width}-{images}-{seed}"
                subprocess.run([ITN, "train", arguments.dataset, "-o", run, "--preset", arguments.preset,
                                "--base-channels", str(width), "--labels", str(images), "--seed", str(seed),
                                "--steps", str(arguments.steps), "--validate-every", str(arguments.steps // 20),
                                "--network-threads", "1", "-q"], check=True, stdout=subprocess.DEVNULL)
                rows.append({"base_channels": width, "images": images, "seed": seed,
                             **evaluated(run, arguments.test or arguments.dataset, arguments.split)})
                write(arguments.runs / "law.csv", rows)


def write(file, rows):
    new = file.with_suffix(".new")
    with open(new, "w", newline="") as stream:
        writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({name: value if name in KEYS else f"{value:.4f}" for name, value in row.items()})
    new.rename(file)


def law(images, errors):
    """Floor, c and alpha of least squares, the floor at least 0."""
    import numpy as np

    best = None
    for alpha in np.arange(0.02, 1.5, 0.01):
        falling = images ** -alpha
        spread = falling - falling.mean()
        c = max(float(spread @ errors / (spread @ spread)), 0)
        floor = float(errors.mean() - c * falling.mean())
        if floor < 0:
            floor, c = 0, float(falling @ errors / (falling @ falling))
        squares = float(((floor + c * falling - errors) ** 2).sum())
        if best is None or squares < best[0]:
            best = squares, floor, c, float(alpha)
    return best[1:]


def bootstrapped(images, errors, draws=200):
    """Laws of errors with the residuals of the law in another order and sign."""
    import numpy as np

    random = np.random.default_rng(0)
    floor, c, alpha = law(images, errors)
    fitted = floor + c * images ** -alpha
    residuals = (errors - fitted) * math.sqrt(len(images) / max(len(images) - 3, 1))
    return [law(images, fitted + random.permutation(residuals) * random.choice([-1, 1], len(images)))
            for _ in range(draws)]


def with_interval(values):
    """The first, and between which all but one in twenty lie."""
    ordered = sorted(values)
    return f"{values[0]:.2f} ({ordered[len(ordered) // 40]:.2f}-{ordered[-1 - len(ordered) // 40]:.2f})"


def fit(arguments):
    import numpy as np

    with open(arguments.file, newline="") as stream:
        rows = list(csv.DictReader(stream))
    print("| base channels | error | of N images, mean of seeds | floor | alpha | with twice as many | with ten times |")
    print("|---|---|---|---|---|---|---|")
    curves = []
    for width in sorted({int(row["base_channels"]) for row in rows}):
        chosen = [row for row in rows if int(row["base_channels"]) == width]
        images = np.array([float(row["images"]) for row in chosen])
        sizes = sorted(set(images))
        if len(sizes) < 4:
            sys.exit(f"{arguments.file}: {len(sizes)} sizes with {width} base channels; a law takes four")
        for name in [*ERRORS, "log_likelihood"]:
            errors = np.array([abs(float(row[name])) for row in chosen])  # log-likelihoods are below 0
            laws = [law(images, errors), *bootstrapped(images, errors)]
            means = [errors[images == size].mean() for size in sizes]
            if name in ERRORS:
                curves.append((width, name, sizes, means, laws[0]))

            def at(size):
                return with_interval([floor + c * size ** -alpha for floor, c, alpha in laws])

            cells = [width, name, ", ".join(f"{n:.0f}: {e:.2f}" for n, e in zip(sizes, means)),
                     with_interval([floor for floor, _, _ in laws]), with_interval([alpha for _, _, alpha in laws]),
                     at(2 * sizes[-1]), at(10 * sizes[-1])]
            print("| " + " | ".join(map(str, cells)) + " |")
    if arguments.picture:
        draw(arguments.picture, curves)


def draw(file, curves):
    import matplotlib
    import numpy as np

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, len(ERRORS), figsize=(10, 3.2), sharey=True)
    for axis, name in zip(axes, ERRORS):
        for marker, (width, _, sizes, means, (floor, c, alpha)) in zip(
                "os^v", [curve for curve in curves if curve[1] == name]):
            [points] = axis.plot(sizes, means, marker, label=f"{width} base channels")
            further = np.geomspace(sizes[0], 10 * sizes[-1])
            axis.plot(further, floor + c * further ** -alpha, color=points.get_color())
        axis.set(xscale="log", title=name, xlabel="images")
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("mean absolute error / constant's")
    axes[0].legend()
    figure.tight_layout()
    figure.savefig(file, dpi=100)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True, dest="command")
    command = commands.add_parser("train")
    command.add_argument("dataset", type=pathlib.Path)
    command.add_argument("runs", type=pathlib.Path)
    command.add_argument("--images", type=int, nargs="+", default=[500, 1000, 2000, 4000, 8000])
    command.add_argument("--base-channels", type=int, nargs="+", default=[16, 32])
    command.add_argument("--seeds", type=int, default=1)
    command.add_argument("--steps", type=int, default=6000)
    command.add_argument("--preset", default="real")
    command.add_argument("--test", type=pathlib.Path, help="default: DATASET")
    command.add_argument("--split", default="test")
    command = commands.add_parser("fit")
    command.add_argument("file", type=pathlib.Path)
    command.add_argument("--picture", type=pathlib.Path)
    arguments = parser.parse_args()
    {"train": train, "fit": fit}[arguments.command](arguments)


if __name__ == "__main__":
    main()
