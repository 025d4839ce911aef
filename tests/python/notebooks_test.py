"""The notebooks of docs/notebooks: their code runs, cell by cell, as it stands there."""

import ast
import json
import os
import pathlib
import unittest
import warnings

FOLDER = pathlib.Path(__file__).resolve().parents[2] / "docs/notebooks"


def run(path):
    """As a notebook does: what a cell ends with is shown."""
    shown, names = [], {"__name__": "__main__"}
    for number, cell in enumerate(json.loads(path.read_text())["cells"]):
        if cell["cell_type"] != "code":
            continue
        tree = ast.parse("".join(cell["source"]), f"{path.name}, cell {number}")
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, f"{path.name}, cell {number}", "exec"), names)
        if last is not None:
            value = eval(compile(ast.Expression(last.value), f"{path.name}, cell {number}", "eval"), names)
            show = getattr(value, "_repr_png_", value.__repr__)
            shown.append(show())
    return shown


class Notebooks(unittest.TestCase):
    def setUp(self):
        warnings.simplefilter("ignore")
        before = os.getcwd()
        os.chdir(FOLDER)
        self.addCleanup(os.chdir, before)

    def test_run(self):
        paths = sorted(FOLDER.glob("*.ipynb"))
        self.assertTrue(paths)
        for path in paths:
            if "torch" in path.read_text():
                try:
                    import torch  # noqa: F401
                except ImportError:
                    continue
            with self.subTest(path.name):
                run(path)

    def test_show_what_they_did(self):
        for path in FOLDER.glob("*.ipynb"):
            cells = [cell for cell in json.loads(path.read_text())["cells"] if cell["cell_type"] == "code"]
            self.assertTrue(any(cell["outputs"] for cell in cells), path.name)
            self.assertFalse([o for cell in cells for o in cell["outputs"] if o["output_type"] == "error"], path.name)


if __name__ == "__main__":
    unittest.main()
