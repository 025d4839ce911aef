#!/usr/bin/env python3
"""Writes the tables of docs/experiments.md from the results in docs/experiments.

  docs/generate/experiments.py           makes the tables again by `itn experiment --tables`, and puts them in the page
  docs/generate/experiments.py --check   says whether both are what they would be; exit code 1 if not

A line <!-- FOLDER/TABLE.csv | COLUMN; COLUMN | ROW; ROW --> in the page says what the table after it has, rows and
columns in this order; without rows it has all. The programs are in the folder ITN_BIN (default: build/release/bin)."""
import csv
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs/experiments.md"
RESULTS = ROOT / "docs/experiments"
PROGRAMS = pathlib.Path(os.environ.get("ITN_BIN", ROOT / "build/release/bin"))
TABLE = re.compile(r"^<!-- (\S+\.csv) \| ([^|]*?)(?: \| (.*))? -->\n((?:\|.*\n)*)", re.M)


def tables_again(results, folder):
    """Makes the tables of a copy without tables; returns their texts by name. The preset that the results are named
    after must be the experiment that they are of."""
    shutil.copytree(results, folder, ignore=shutil.ignore_patterns("*.csv"))
    subprocess.run([PROGRAMS / "itn", "experiment", "--preset", results.name, "--status", "-o", folder], check=True,
                   stdout=subprocess.DEVNULL)
    subprocess.run([PROGRAMS / "itn", "experiment", "--tables", "-o", folder], check=True, stdout=subprocess.DEVNULL)
    return {f"{results.name}/{file.name}": file.read_text() for file in sorted(folder.glob("*.csv"))}


def number(text):
    value = float(text)
    if value == int(value) and abs(value) >= 100:  # a count
        return f"{value:.0f}"
    digits = 1 if abs(value) >= 10 else 2 if abs(value) >= 2 else 3
    return re.sub(r"^(-?)0\.", r"\1.", f"{value:.{digits}f}")


def cell(row, column):
    if not row[column]:
        return ""
    interval = [row[f"{column} {end}"] for end in ("low", "high")]
    return number(row[column]) + (f" ({number(interval[0])}-{number(interval[1])})" if all(interval) else "")


def chosen(kind, names, known, file):
    for name in names:
        if name not in known:
            sys.exit(f"{PAGE.relative_to(ROOT)}: {file} has no {kind} {name}; it has {'; '.join(known)}")
    return names


def markdown(match, tables):
    [file] = chosen("table", [match[1]], list(tables), "docs/experiments")
    reader = csv.DictReader(tables[file].splitlines())
    rows = {row["name"]: row for row in reader}
    columns = chosen("column", match[2].split("; "), reader.fieldnames, file)
    names = chosen("row", match[3].split("; "), list(rows), file) if match[3] else list(rows)
    lines = [["", *columns], ["---"] * (1 + len(columns))]
    lines += [[name, *(cell(rows[name], column) for column in columns)] for name in names]
    return match[0][:match.start(4) - match.start()] + "".join(f"| {' | '.join(line)} |\n" for line in lines)


def main():
    tables = {}
    with tempfile.TemporaryDirectory() as scratch:
        for results in sorted(path.parent for path in RESULTS.glob("*/experiment.textproto")):
            tables |= tables_again(results, pathlib.Path(scratch) / results.name)
    page = TABLE.sub(lambda match: markdown(match, tables), PAGE.read_text())
    files = {RESULTS / name: text for name, text in tables.items()} | {PAGE: page}
    faults = [file for file, text in files.items() if not file.exists() or file.read_text() != text]
    faults += [file for file in RESULTS.glob("*/*.csv") if file not in files]  # of no table any more
    if sys.argv[1:] == ["--check"]:
        for file in faults:
            print(f"FAILED: {file.relative_to(ROOT)} is not what docs/generate/experiments.py makes")
        print(f"{len(tables)} tables, {len(TABLE.findall(page))} of them in the page")
        return 1 if faults or not tables else 0
    if sys.argv[1:]:
        sys.exit(__doc__)
    for file in faults:
        file.write_text(files[file]) if file in files else file.unlink()
    return 0


if __name__ == "__main__":
    sys.exit(main())
