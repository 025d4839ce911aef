#!/usr/bin/env python3
"""Refuses names that the code has left for the field's own: tests/style/old_words.txt says which, and what is
right instead. CHANGELOG.md may have them."""
import pathlib
import re
import subprocess
import sys

root = pathlib.Path(__file__).resolve().parents[2]
words = dict(line.split() for line in (root / "tests/style/old_words.txt").read_text().splitlines())
old = re.compile(r"\b(" + "|".join(map(re.escape, words)) + r")\b")
listed = subprocess.run(["git", "-C", str(root), "ls-files", "*.h", "*.cpp", "*.proto", "*.md"], check=True,
                        capture_output=True, text=True).stdout.split()
found = 0
for name in listed:
    path = root / name
    if name == "CHANGELOG.md" or not path.is_file():
        continue
    for number, line in enumerate(path.read_text().splitlines(), 1):
        for word in old.findall(line):
            print(f"{name}:{number}: {word} is called {words[word]}")
            found += 1
sys.exit(1 if found else 0)
