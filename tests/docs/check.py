#!/usr/bin/env python3
"""What README.md and docs/ say is so. Exit code 1 with a line for each thing that is not.

  check.py words          lengths, sentences, flags, paths, links and anchors of all pages
  check.py run PAGE       runs the page's fences `sh run`, in one shell, and then `python run`, in one interpreter;
                          77: there are no network namespaces, or what draws pictures is missing
  check.py nightly PAGE   those of `nightly`, too

A fence says what it is: sh run, sh nightly, sh show (needs root, or a cluster), python run, python nightly, textproto
scene or dataset, output, text (of other programs)."""
import functools
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAMS = pathlib.Path(os.environ.get("ITN_BIN", ROOT / "build/release/bin"))
PAGES = sorted({ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")})
KINDS = {"sh run", "sh nightly", "sh show", "python run", "python nightly", "textproto scene", "textproto dataset", "output", "text"}
FENCE = re.compile(r"^```([^\n]*)\n(.*?)^```$", re.M | re.S)
faults = []


def fault(page, what):
    faults.append(f"{page.relative_to(ROOT)}: {what}"[:300])


def fences(page):
    return [(m[1], m[2]) for m in FENCE.finditer(page.read_text())]


# --- Sentences ---

def sentences(text):
    """Of prose: no fences, tables, headings, pictures."""
    text = FENCE.sub("\n\n", text)
    text = re.sub(r"^(#|\||!\[|    ).*$", "", text, flags=re.M)
    text = re.sub(r"`[^`]*`", "code", text)
    text = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", text)
    for paragraph in re.split(r"\n\s*\n|\n\s*(?:[-*]|\d+\.)\s", text):
        for sentence in re.split(r"(?<=[.?!])[\s*]+", " ".join(paragraph.split())):
            if sentence:
                yield sentence


def check_lengths():
    readme = ROOT / "README.md"
    text = readme.read_text()
    if text.count("\n") > 200:
        fault(readme, f"{text.count(chr(10))} lines; it has 200 at most")
    for number, line in enumerate(text.split("\n"), 1):
        if len(line) > 120:
            fault(readme, f"line {number} has {len(line)} columns")
    lengths = [(len(s.split()), s) for s in sentences(text)]
    long = [s for n, s in lengths if n > 25]
    print(f"README.md: {text.count(chr(10))} lines, {len(lengths)} sentences, {len(long)} of more than 25 words, "
          f"{sum(n > 40 for n, _ in lengths)} of more than 40")
    if len(long) > 15:
        fault(readme, f"{len(long)} sentences of more than 25 words: {long}")
    for n, sentence in lengths:
        if n > 40:
            fault(readme, f"a sentence of {n} words: {sentence}")


# --- Flags ---

@functools.cache
def help_of(words):
    result = subprocess.run([str(PROGRAMS / words[0]), *words[1:], "--help"], capture_output=True, text=True)
    return set(re.findall(r"--[a-z][a-z0-9-]*", result.stdout)) if result.returncode == 0 else None


def commands():
    text = subprocess.run([str(PROGRAMS / "itn"), "--help"], capture_output=True, text=True, check=True).stdout
    return set(re.findall(r"^  ([a-z]+) ", text, re.M))


def check_flags():
    names, every = commands(), set()
    for name in names:
        every |= help_of(("itn", name)) or set()
    for program in ("itn-worker", "itn-predictor"):
        every |= help_of((program,))
    for page in PAGES:
        for kind, text in fences(page):
            if not kind.startswith("sh"):
                continue
            joined = re.sub(r"#.*", "", text.replace("\\\n", " "))
            for line in re.split(r"[\n|;&]|&&", joined):
                words = line.split()
                for i, word in enumerate(words):
                    program = None
                    if word == "itn" and i + 1 < len(words) and words[i + 1] in names:
                        program = ("itn", words[i + 1])
                    elif word in ("itn-worker", "itn-predictor"):
                        program = (word,)
                    if program:
                        for flag in re.findall(r"(?<=\s)--[a-z][a-z0-9-]*", " " + " ".join(words[i + 1:])):
                            if flag not in help_of(program):
                                fault(page, f"{' '.join(program)} has no {flag}")
        prose = FENCE.sub("", page.read_text())
        for code in re.findall(r"`([^`]*)`", prose):
            m = re.match(r"itn ([a-z]+) ", code)
            allowed = help_of(("itn", m[1])) if m and m[1] in names else None
            for flag in re.findall(r"(?:^|\s)(--[a-z][a-z0-9-]*)", code):
                elsewhere = re.match(r"(apt-get|cmake|ctest|tests/|docker|blender|[a-z_]+_bench)", code)
                if not elsewhere and flag not in (allowed or every) and flag not in OTHER_FLAGS:
                    fault(page, f"no program has {flag} (`{code}`)")


# Of scripts and benchmarks, alone in the text.
OTHER_FLAGS = {"--json", "--each", "--quick", "--concurrency", "--rate", "--predict"}


# --- Paths, links, anchors ---

def anchors(page):
    text = FENCE.sub("", page.read_text())
    return {re.sub(r"[^a-z0-9_ -]", "", h.lower()).strip().replace(" ", "-")
            for h in re.findall(r"^#+ (.*)$", text, re.M)}


def check_links():
    for page in [*PAGES, *sorted((ROOT / "docs/reference").glob("*.md"))]:
        text = FENCE.sub("", page.read_text())
        for target in re.findall(r"\]\(([^)\s]+)\)", text):
            if re.match(r"https?:", target):
                continue
            path, _, anchor = target.partition("#")
            file = (page.parent / path).resolve() if path else page
            if not file.exists():
                fault(page, f"no {target}")
            elif anchor and anchor not in anchors(file):
                fault(page, f"no heading #{anchor} in {path or page.name}")
        if page.parent.name == "reference":
            continue
        for code in re.findall(r"`([^`\s]+/[^`\s]*)`", text):
            path = code.split(":")[0].rstrip("/")
            top = path.split("/")[0]
            if top in ("client", "common", "server", "tests", "deploy", "docs", "models", "proto"):
                if not (ROOT / path).exists():
                    fault(page, f"no file {path}")


def check_fences():
    for page in PAGES:
        for kind, text in fences(page):
            if kind not in KINDS:
                fault(page, f"a fence of the kind \"{kind}\"; there are {', '.join(sorted(KINDS))}")
            if kind.startswith("textproto"):
                check_textproto(page, kind.split()[1], text)


def check_textproto(page, kind, text):
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "example.textproto"
        file.write_text(text)
        if kind == "dataset":
            command = ["dataset", "--config", str(file), "--print-config"]
        else:
            command = ["render", str(file), "-o", folder + "/a.exr", "--sigma-t", "9", "--albedo", "0.5", "--spp", "1"]
        result = subprocess.run([str(PROGRAMS / "itn"), *command], capture_output=True, text=True)
        if result.returncode != 0:
            fault(page, f"an example is refused: {result.stderr.strip()}")


def check_reference():
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, str(ROOT / "docs/generate/reference.py"), folder], check=True)
        for file in sorted(pathlib.Path(folder).iterdir()):
            kept = ROOT / "docs/reference" / file.name
            if not kept.exists() or kept.read_text() != file.read_text():
                fault(kept, "is not what docs/generate/reference.py makes of the protos")
            for row in re.findall(r"^\| `(\w+)` .*\|  \|$", file.read_text(), re.M):
                fault(kept, f"{row} has no comment in its proto")


def check_manual():
    """Of each command a page that has its flags."""
    if shutil.which("help2man") is None:
        print("no help2man: pages of the manual are not checked")
        return
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([ROOT / "docs/generate/manual.sh", PROGRAMS, folder], check=True)
        for program in [("itn-worker",), ("itn-predictor",), *(("itn", name) for name in commands())]:
            page = pathlib.Path(folder) / ("-".join(program) + ".1")
            told = page.read_text().replace("\\-", "-") if page.exists() else ""
            for flag in help_of(program):
                if flag not in told:
                    fault(ROOT / "docs/generate/manual.sh", f"{page.name} has no {flag}")


def check_figures():
    rows = (ROOT / "docs/figures.tsv").read_text().splitlines()[1:]
    known = {number for row in rows for number in re.findall(r"\d+(?:\.\d+)?", row.split("\t")[1])}
    readme = ROOT / "README.md"
    table = re.search(r"## What is measured\n(.*?)\n## ", readme.read_text(), re.S)[1]
    for row in re.findall(r"^\| [^|]+ \| ([^|]*\d[^|]*) \|", table, re.M):
        for number in re.findall(r"\d+(?:\.\d+)?", row):
            if number not in known:
                fault(readme, f"the figure {number} is not in docs/figures.tsv")


# --- Commands ---

def run(page, kinds):
    script, python = ("".join(text for kind, text in fences(page) if kind in {f"{language} {k}" for k in kinds})
                      for language in ("sh", "python"))
    if python:
        script += f"{ROOT}/build/python/bin/python - <<'END_OF_PYTHON'\n{python}END_OF_PYTHON\n"
    if not script:
        sys.exit(f"{page} has no fence to run")
    if "picture.py" in script and subprocess.run(["/usr/bin/python3", "-c", "import OpenImageIO"],
                                                 capture_output=True).returncode != 0:
        print("SKIPPED: pictures need python3-openimageio")
        sys.exit(77)
    alone = ["unshare", "--map-root-user", "--net", "--pid", "--fork", "--kill-child"]
    if subprocess.run([*alone, "true"], capture_output=True).returncode != 0:
        print("SKIPPED: no network namespaces here")
        sys.exit(77)
    with tempfile.TemporaryDirectory() as folder:
        for name in os.listdir(ROOT):
            if name in (".git", "build", "out"):
                continue
            if name in ("docs", "deploy"):
                shutil.copytree(ROOT / name, pathlib.Path(folder) / name)
            else:
                os.symlink(ROOT / name, pathlib.Path(folder) / name)
        # Its process number 1 ends, and with it all that it left behind.
        script = f"set -euo pipefail\nip link set lo up\nexport PATH={PROGRAMS}:$PATH\n" \
                 f"export PYTHONPATH={PROGRAMS.parent / 'python'}\n{script}"
        result = subprocess.run([*alone, "bash", "-c", script], cwd=folder)
    if result.returncode != 0:
        sys.exit(f"{page.relative_to(ROOT)}: its commands end with {result.returncode}")


def main():
    if sys.argv[1:] == ["words"]:
        for check in (check_lengths, check_flags, check_links, check_fences, check_reference, check_manual,
                      check_figures):
            check()
        for line in faults:
            print("FAILED:", line, file=sys.stderr)
        sys.exit(1 if faults else 0)
    if len(sys.argv) == 3 and sys.argv[1] in ("run", "nightly"):
        kinds = {"run", "nightly"} if sys.argv[1] == "nightly" else {"run"}
        run(ROOT / sys.argv[2], kinds)
        return
    sys.exit(__doc__)


main()
