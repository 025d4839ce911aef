"""Ratios of a run of tracer_bench, as a table or as JSON: summarise.py table|json FILE"""
import json
import math
import sys

VARIANTS = ("reference", "wavefront", "images", "image only", "same walks")
QUANTITIES = ("image", "sigma_t", "albedo", "g")


def ratios(row):
    """Of the wavefront to the reference: walk steps per second, and error at equal CPU time."""
    reference, wavefront, images, image, same_walks = (row[v] for v in VARIANTS)
    result = {"reference_steps_per_second": reference["steps_per_second"],
              "wavefront_steps_per_second": same_walks["steps_per_second"],
              "speed": same_walks["steps_per_second"] / reference["steps_per_second"],
              "grad_over_image": images["cpu_seconds"] / image["cpu_seconds"]}
    for quantity in QUANTITIES:
        fast = image if quantity == "image" else wavefront
        result[quantity] = (reference[quantity][1] * reference["cpu_seconds"]
                            / (fast[quantity][1] * fast["cpu_seconds"]))
    return result


def geometric_mean(values):
    return math.exp(sum(math.log(v) for v in values) / len(values))


def each_technique(row):
    """How much worse variance x CPU time is without a technique."""
    known = ("scene", "sigma_t", "albedo", "g", *VARIANTS)
    full = row["wavefront"]
    return {name: {q: v[q][1] * v["cpu_seconds"] / (full[q][1] * full["cpu_seconds"])
                   for q in QUANTITIES[1:]}
            for name, v in row.items() if name not in known}


def name_of(row):
    return f"{row['scene']} {row['sigma_t']:g},{row['albedo']:g},{row['g']:g}"


def print_table(rows, scenes):
    print("Wavefront against reference: M walk steps per second and core of the same walks, and")
    print("their ratio;")
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
        print("\nVariance x CPU time of the loss gradient without a technique / with all, geometric "
              "means:")
        for name in techniques[0]:
            print(f"{name:59}{'':11}" + "".join(
                f"{geometric_mean([t[name][q] for t in techniques]):10.2f}x"
                for q in QUANTITIES[1:]))


def print_others(rows):
    """The parts that need no ratios."""
    paper = {r["paper_scene"]: r["cpu_seconds"] for r in rows if "paper_scene" in r}
    if paper:
        print("\nA cube on the ground, sigma_t 100, albedo 0.8, g 0.2, 128 x 128, 256 spp, image and "
              "three derivatives:")
        print("  " + ", ".join(f"{name} {seconds:.2f} CPU-seconds" for name, seconds in paper.items()))
    scaling = [r for r in rows if "scaling" in r]
    if scaling:
        print("\nImage and three derivatives of a bumpy ball, all threads:")
        print(f"{'pixels':>12}{'spp':>7}{'triangles':>11}{'sigma_t':>9}{'albedo':>8}{'set-up':>9}"
              f"{'wall':>9}{'CPU':>9}"
              f"{'peak':>9}")
    for r in scaling:
        print(f"{r['resolution']:>5} x {r['resolution']:<4}{r['spp']:>7}{r['triangles']:>11}"
              f"{r['sigma_t']:>9}{r['albedo']:>8}"
              f"{r['set_up_seconds']:>7.2f} s{r['wall_seconds']:>7.2f} s{r['cpu_seconds']:>7.2f} s"
              f"{r['peak_mb']:>6} MB")
    datasets = [r for r in rows if "dataset" in r]
    if datasets:
        print("\nImages of 2 % error on the object per CPU-hour, extrapolated from renders of 64 spp:")
    for r in datasets:
        print(f"  {r['dataset']}: {r['images_per_cpu_hour']:.0f} ({r['images']} images); 14,400 take "
              f"{r['hours_for_14400_on_2_cores']:.1f} hours on two cores")


def main():
    form, path = sys.argv[1:]
    rows = [json.loads(line) for line in open(path)]
    compared = [row for row in rows if "scene" in row]
    scenes = {name_of(row): ratios(row) for row in compared}
    if form == "json":
        print(json.dumps({"scenes": scenes, "runs": rows}, indent=2))
        return
    if compared:
        print_table(compared, scenes)
    print_others(rows)


if __name__ == "__main__":
    main()
