"""Medians and ratios of a run of tracer_bench: summarise.py table|json RESULT.json"""
import json
import math
import sys
from statistics import median


def medians(path):
    """{scene: {variant: {quantity: median}}}"""
    runs = {}
    for run in json.load(open(path))["benchmarks"]:
        if run["run_type"] == "iteration":
            scene, variant = run["run_name"].replace("/real_time", "").split("/")[:2]
            values = runs.setdefault(scene, {}).setdefault(variant, {})
            for quantity in ("cpu_time", "real_time", "steps_per_cpu_second", "error_times_cpu"):
                if quantity in run:
                    values.setdefault(quantity, []).append(run[quantity])
    return {scene: {variant: {quantity: median(v) for quantity, v in values.items()}
                    for variant, values in variants.items()}
            for scene, variants in runs.items()}


def row(variants):
    plain, standard, grid = (variants[v] for v in ("plain", "standard", "grid"))
    return {
        "plain_steps_per_second": plain["steps_per_cpu_second"],
        "standard_steps_per_second": standard["steps_per_cpu_second"],
        "grid_steps_per_second": grid["steps_per_cpu_second"],
        "steps_ratio": standard["steps_per_cpu_second"] / plain["steps_per_cpu_second"],
        "equal_error_ratio": plain["error_times_cpu"] / standard["error_times_cpu"],
        "grad_over_image": standard["cpu_time"] / variants["image only"]["cpu_time"],
    }


def main():
    form, path = sys.argv[1:]
    scenes = medians(path)
    call = scenes.pop("call")
    rows = {scene: row(scenes[scene]) for scene in sorted(scenes)}
    remote = call["remote"]["real_time"] / call["embedded"]["real_time"]
    if form == "json":
        print(json.dumps({"scenes": rows, "remote_over_embedded": remote}, indent=2))
        return
    print("M walk steps per second and core; equal error: variance x CPU time, plain / standard")
    print(f"{'':24}{'plain':>8}{'standard':>10}{'grid':>8}{'steps':>8}{'equal error':>13}"
          f"{'grad/image':>12}")
    for scene, r in rows.items():
        print(f"{scene:24}{r['plain_steps_per_second'] / 1e6:8.2f}"
              f"{r['standard_steps_per_second'] / 1e6:10.2f}{r['grid_steps_per_second'] / 1e6:8.2f}"
              f"{r['steps_ratio']:7.2f}x{r['equal_error_ratio']:12.2f}x{r['grad_over_image']:11.2f}x")
    mean = {k: math.exp(sum(math.log(r[k]) for r in rows.values()) / len(rows))
            for k in ("steps_ratio", "equal_error_ratio", "grad_over_image")}
    print(f"{'geometric mean':24}{'':26}{mean['steps_ratio']:7.2f}x{mean['equal_error_ratio']:12.2f}x"
          f"{mean['grad_over_image']:11.2f}x")
    print(f"a call over the loopback takes {remote:.2f} times one inside the process "
          "(128 x 128, 16 spp, three derivatives, two estimates)")


if __name__ == "__main__":
    main()
