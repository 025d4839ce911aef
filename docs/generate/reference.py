#!/usr/bin/env python3
"""Writes docs/reference: a page for each proto, with a table for each message, and one of all commands.

  docs/generate/reference.py [FOLDER]     default: docs/reference

Needs protoc, python3-protobuf and the programs, in the folder ITN_BIN (default: build/release/bin)."""
import os
import pathlib
import re
import subprocess
import sys
import tempfile

from google.protobuf import descriptor_pb2

ROOT = pathlib.Path(__file__).resolve().parents[2]
PAGES = {
    "scene": "a scene: object, surfaces, lights, camera, film",
    "dataset": "datasets: what is drawn for each image, and the manifest",
    "learning": "trainings: configuration, metrics, models, evaluations",
    "experiment": "experiments: networks, stages, tables",
    "refine": "refinements: result, trajectory, state",
    "render": "the render service",
    "predict": "the prediction service",
    "relay": "renders through a pipe",
}
PROGRAMS = pathlib.Path(os.environ.get("ITN_BIN", ROOT / "build/release/bin"))
MESSAGE, ENUM, SERVICE = 4, 5, 6  # numbers of fields in FileDescriptorProto
FIELD = descriptor_pb2.FieldDescriptorProto


def descriptors():
    with tempfile.NamedTemporaryFile() as out:
        subprocess.run(["protoc", f"-I{ROOT}/proto", "--include_imports", "--include_source_info",
                        f"--descriptor_set_out={out.name}",
                        *sorted(str(p) for p in (ROOT / "proto/itn/v1").glob("*.proto"))], check=True)
        return descriptor_pb2.FileDescriptorSet.FromString(pathlib.Path(out.name).read_bytes()).file


def anchor(name):
    return re.sub(r"[^a-z0-9_-]", "", name.lower())


class Page:
    def __init__(self, file, home):
        self.file, self.home = file, home
        self.comments = {tuple(l.path): " ".join((l.leading_comments or l.trailing_comments).split())
                         for l in file.source_code_info.location}
        self.lines = []

    def comment(self, path):
        text = re.sub(r"([|<>])", r"\\\1", self.comments.get(path, ""))
        return text.replace("`\\<", "`<").replace("\\>`", ">`")

    def link(self, type_name):
        name = type_name.rsplit(".v1.")[-1]
        if type_name not in self.home:
            return name
        page = self.home[type_name]
        return f"[{name}]({'' if page == self.name else page + '.md'}#{anchor(name)})"

    @property
    def name(self):
        return pathlib.Path(self.file.name).stem

    def type_of(self, field, message):
        kind = FIELD.Type.Name(field.type)[5:].lower()
        if field.type in (FIELD.TYPE_MESSAGE, FIELD.TYPE_ENUM):
            for nested in message.nested_type:
                if nested.options.map_entry and field.type_name.endswith("." + nested.name):
                    key, value = (self.type_of(f, nested) for f in nested.field)
                    return f"map of {key} to {value}"
            kind = self.link(field.type_name)
        return f"list of {kind}" if field.label == FIELD.LABEL_REPEATED else kind

    def add_enum(self, enum, path, name):
        self.lines += [f"### {name}", "", self.comment(path), "", "| value | number | |", "|---|---|---|"]
        for i, value in enumerate(enum.value):
            self.lines.append(f"| `{value.name}` | {value.number} | {self.comment(path + (2, i))} |")
        self.lines.append("")

    def add_message(self, message, path, name):
        self.lines += [f"### {name}", "", self.comment(path), ""]
        if message.field:
            self.lines += ["| field | type | |", "|---|---|---|"]
        for i, field in enumerate(message.field):
            one_of = ""
            if field.HasField("oneof_index") and not field.proto3_optional:
                one_of = f"One of `{message.oneof_decl[field.oneof_index].name}`. "
            self.lines.append(f"| `{field.name}` | {self.type_of(field, message)} | "
                              f"{one_of}{self.comment(path + (2, i))} |")
        self.lines.append("")
        for i, nested in enumerate(message.nested_type):
            if not nested.options.map_entry:
                self.add_message(nested, path + (3, i), f"{name}.{nested.name}")
        for i, enum in enumerate(message.enum_type):
            self.add_enum(enum, path + (4, i), f"{name}.{enum.name}")

    def text(self):
        self.lines = [f"# {self.name}.proto", "",
                      f"Of {PAGES[self.name]}. Made by `docs/generate/reference.py` from "
                      f"`proto/{self.file.name}`: change that.", ""]
        for i, service in enumerate(self.file.service):
            self.lines += [f"### {service.name}", "", self.comment((SERVICE, i)), "",
                           "| call | takes | answers | |", "|---|---|---|---|"]
            for k, call in enumerate(service.method):
                self.lines.append(f"| `{call.name}` | {self.link(call.input_type)} | "
                                  f"{self.link(call.output_type)} | {self.comment((SERVICE, i, 2, k))} |")
            self.lines.append("")
        for i, message in enumerate(self.file.message_type):
            self.add_message(message, (MESSAGE, i), message.name)
        for i, enum in enumerate(self.file.enum_type):
            self.add_enum(enum, (ENUM, i), enum.name)
        return re.sub(r"\n{3,}", "\n\n", "\n".join(self.lines)).rstrip() + "\n"


def types_in(prefix, messages, enums):
    for enum in enums:
        yield f"{prefix}.{enum.name}"
    for message in messages:
        yield f"{prefix}.{message.name}"
        yield from types_in(f"{prefix}.{message.name}", message.nested_type, message.enum_type)


def cell(text):
    return text.replace("|", "\\|").replace("<", "&lt;")


def help_of(*words):
    text = subprocess.run([PROGRAMS / words[0], *words[1:], "--help"], capture_output=True, text=True, check=True)
    # CLI11 lists these in the order of addresses, which is another in every build.
    return re.sub(r"((?:Excludes|Needs):)((?: --[\w-]+)+)",
                  lambda found: f"{found[1]} {' '.join(sorted(found[2].split()))}", text.stdout)


def command_page():
    """Of what --help says: an entry is a flag and its text, on this line or on the next."""
    names = re.findall(r"^  ([a-z]+) ", help_of("itn").split("Subcommands:")[1], re.M)
    commands = [*(("itn", name) for name in names), ("itn-worker",), ("itn-predictor",)]
    lines = ["# Commands", "", "What `--help` says of each. Made by `docs/generate/reference.py`.", ""]
    for command in commands:
        title, usage, rest = help_of(*command).split("\n", 2)
        lines += [f"## {' '.join(command)}", "", f"{cell(title)}.".replace("..", "."), "",
                  f"`{usage.removeprefix('Usage: ')}`", "", "| | |", "|---|---|"]
        for flag, text in re.findall(r"^  (\S.*?)(?:  +|\n {10,})(\S.*)$", rest, re.M):
            if not flag.startswith("-h,"):
                lines.append(f"| `{flag}` | {cell(text)} |")
        lines.append("")
    return "\n".join(lines).rstrip() + "\n"


def main():
    if any(argument.startswith("-") for argument in sys.argv[1:]):
        sys.exit("docs/generate/reference.py has no flags; it takes a folder to write to (default: docs/reference)")
    folder = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "docs/reference")
    files = [f for f in descriptors() if f.package == "itn.v1"]
    home = {name: pathlib.Path(f.name).stem
            for f in files for name in types_in(".itn.v1", f.message_type, f.enum_type)}
    folder.mkdir(parents=True, exist_ok=True)
    for file in files:
        page = Page(file, home)
        (folder / f"{page.name}.md").write_text(page.text())
    (folder / "commands.md").write_text(command_page())
    index = "| [commands](commands.md) | every flag of every command |\n" + "\n".join(f"| [{name}]({name}.md) | {about} |" for name, about in PAGES.items())
    (folder / "README.md").write_text(
        "# Reference\n\nEvery flag of every command, and every field of every file and message, with unit, range and default. Text files are protobuf "
        "text format of\nthese messages. Made by `docs/generate/reference.py`.\n\n| page | of |\n|---|---|\n" + index + "\n")


main()
