#!/usr/bin/env python3
"""Writes docs/reference/python.md from the docstrings of the package itn, which PYTHONPATH finds.

python.py            writes it
python.py --check    exit code 1 if what is written is another
"""

import inspect
import pathlib
import re
import sys
import textwrap

import itn
import itn.torch

PAGE = pathlib.Path(__file__).resolve().parents[1] / "reference/python.md"


def signature_of(name, function):
    parts = []
    for parameter in inspect.signature(function).parameters.values():
        if parameter.name == "self":
            continue
        if parameter.kind is parameter.KEYWORD_ONLY and "*" not in parts and not any(p.startswith("*") for p in parts):
            parts.append("*")
        text = str(parameter.replace(annotation=parameter.empty))
        parts.append(text)
    return f"{name}({', '.join(parts)})"


def text_of(docstring):
    """Lines `name: text` of indented blocks become a list."""
    paragraphs = []
    for paragraph in inspect.cleandoc(docstring or "").split("\n\n"):
        lines = paragraph.split("\n")
        if re.match(r"[a-z_]+(, [a-z_]+)*: ", lines[0]):
            joined = []
            for line in lines:
                if line.startswith(" ") and joined:
                    joined[-1] += " " + line.strip()
                else:
                    joined.append(line)
            paragraphs.append(
                "\n".join(
                    textwrap.fill(
                        re.sub(
                            r"^([a-z_, ]+): ",
                            lambda m: "- " + ", ".join(f"`{n}`" for n in m[1].split(", ")) + ": ",
                            line,
                        ),
                        120,
                        subsequent_indent="  ",
                        break_long_words=False,
                        break_on_hyphens=False,
                    )
                    for line in joined
                )
            )
        elif any(line.startswith("    ") for line in lines):
            paragraphs.append("```text\n" + textwrap.dedent(paragraph) + "\n```")
        else:
            paragraphs.append(textwrap.fill(" ".join(lines), 120, break_long_words=False, break_on_hyphens=False))
    return "\n\n".join(paragraphs)


def fields_of(cls):
    """Comments `#: text` before the fields of a class, or behind them."""
    rows, said = [], []
    for line in inspect.getsource(cls).splitlines()[1:]:
        line = line.strip()
        if line.startswith("#: "):
            said.append(line[3:])
        elif match := re.match(r"(\w+): .*?(?:#: (.*))?$", line):
            text = match[2] or " ".join(said)
            if text:
                rows.append(f"- `{match[1]}`: {text}")
            said = []
        elif not line.startswith("#"):
            said = []
    return rows


def page():
    lines = [
        "# The Python package",
        "",
        "Made by docs/generate/python.py of docstrings. [python.md](../python.md) shows how to use it.",
        "",
    ]
    for module, names in ((itn, itn.__all__), (itn.torch, ["render", "render_batch"])):
        # What one calls comes first, then what comes back, then what is raised.
        kinds = (inspect.isfunction, lambda held: not issubclass(held, Exception), lambda held: True)
        kind_of = {
            name: next(i for i, kind in enumerate(kinds) if kind(getattr(module, name)))
            for name in names
            if inspect.isclass(getattr(module, name)) or inspect.isfunction(getattr(module, name))
        }
        for name in sorted(kind_of, key=lambda name: (kind_of[name], name)):
            held = getattr(module, name)
            full = f"{module.__name__}.{name}"
            if not held.__doc__:
                continue
            lines += [f"## {full}", ""]
            if inspect.isfunction(held):
                lines += ["```text", textwrap.fill(signature_of(full, held), 110, subsequent_indent="    "), "```", ""]
            lines += [text_of(held.__doc__), ""]
            if not inspect.isclass(held):
                continue
            if fields := fields_of(held):
                lines += ["\n".join(textwrap.fill(row, 120, subsequent_indent="  ") for row in fields), ""]
            for member, what in vars(held).items():
                if (
                    member.startswith("_")
                    or not what.__doc__
                    or not (inspect.isfunction(what) or isinstance(what, property))
                ):
                    continue
                shown = f"`.{member}`" if isinstance(what, property) else f"`.{signature_of(member, what)}`"
                lines += [f"{shown}:", text_of(what.__doc__), ""]
    return "\n".join(lines).rstrip() + "\n"


if sys.argv[1:] == ["--check"]:
    if not PAGE.exists() or PAGE.read_text() != page():
        sys.exit(f"{PAGE} is not what this program makes of the docstrings")
else:
    PAGE.write_text(page())
