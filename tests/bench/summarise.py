"""Ratios of a run of tracer_bench, as a table or as JSON: summarise.py table|json FILE"""
import json
import math
import sys

QUANTITIES = ("image", "sigma_t", "albedo", "g")


def ratios(row):
    """Of the wavefront to the reference: walk steps per second, and error at equal CPU time."""
    reference, wavefront, image = (row[v] for v in ("reference", "wavefront", "image only"))
    result = {"reference_steps_per_second": reference["steps_per_second"],
              "wavefront_steps_per_second": wavefront["steps_per_second"],
              "speed": wavefront["steps_per_second"] / reference["steps_per_second"],
              "grad_over_image": wavefront["cpu_seconds"] / image["cpu_seconds"]}
    for quantity in QUANTITIES:
        fast = image if quantity == "image" else wavefront
        result[quantity] = (reference[quantity][1] * reference["cpu_seconds"]
                            / (fast[quantity][1] * fast["cpu_seconds"]))
    return result


def geometric_mean(values):
    return math.exp(sum(math.log(v) for v in values) / len(values))


def each_technique(row):
    """How much worse variance x CPU time is without a technique."""
    known = ("scene", "sigma_t", "albedo", "g", "reference", "wavefront", "image only")
    full = row["wavefront"]
    return {name: {q: v[q][1] * v["cpu_seconds"] / (full[q][1] * full["cpu_seconds"])
                   for q in QUANTITIES}
            for name, v in row.items() if name not in known}


def name_of(row):
    return f"{row['scene']} {row['sigma_t']:g},{row['albedo']:g},{row['g']:g}"


def print_table(rows, scenes):
    print("Wavefront against reference: M walk steps per second and core, and their ratio;")
    print("variance x CPU time of the image and of the loss gradient, reference / wavefront;")
    print("CPU time with three derivatives / of the image alone.")
    header = ["scene", "reference", "wavefront", "speed", "image", "sigma_t", "albedo", "g",
              "grad/image"]
    print(f"{header[0]:26}" + "".join(f"{h:>11}" for h in header[1:]))
    for name, r in scenes.items():
        print(f"{name:26}{r['reference_steps_per_second'] / 1e6:11.2f}"
              f"{r['wavefront_steps_per_second'] / 1e6:11.2f}{r['speed']:10.2f}x"
              + "".join(f"{r[q]:10.1f}x" for q in QUANTITIES) + f"{r['grad_over_image']:10.2f}x")
    columns = ("speed", *QUANTITIES, "grad_over_image")
    for label, summary in (("geometric mean", geometric_mean), ("least", min), ("greatest", max)):
        values = [summary([r[c] for r in scenes.values()]) for c in columns]
        print(f"{label:48}" + f"{values[0]:10.2f}x" + "".join(f"{v:10.1f}x" for v in values[1:-1])
              + f"{values[-1]:10.2f}x")
    techniques = [each_technique(row) for row in rows]
    if techniques and techniques[0]:
        print("\nVariance x CPU time without a technique / with all, geometric means:")
        for name in techniques[0]:
            print(f"{name:48}{'':11}" + "".join(
                f"{geometric_mean([t[name][q] for t in techniques]):10.2f}x" for q in QUANTITIES))


def main():
    form, path = sys.argv[1:]
    rows = [json.loads(line) for line in open(path)]
    scenes = {name_of(row): ratios(row) for row in rows}
    if form == "json":
        print(json.dumps({"scenes": scenes, "runs": rows}, indent=2))
    else:
        print_table(rows, scenes)


if __name__ == "__main__":
    main()
