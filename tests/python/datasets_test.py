"""Datasets in Python: what is in their files, and how PyTorch reads them."""

import pathlib
import subprocess
import tempfile
import unittest

import itn
import numpy as np
from itn import _core, programs

try:
    import torch
except ImportError:
    torch = None


class Datasets(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.folders = {name: f"{cls.temporary.name}/{name}" for name in ("gray", "colour")}
        for name, flags in (("gray", []), ("colour", ["--preset", "real"])):
            subprocess.run(
                [
                    programs.find("itn"),
                    "dataset",
                    cls.folders[name],
                    "--random-shapes",
                    "6",
                    "--count",
                    "12",
                    "--resolution",
                    "16",
                    "--noise",
                    "100%",
                    "--test-fraction",
                    "0.34",
                    "--quiet",
                    *flags,
                ],
                check=True,
            )

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    def test_have_images_and_their_truth(self):
        data = itn.Dataset(self.folders["colour"])
        everything = itn.Dataset(self.folders["colour"], "all")
        self.assertEqual(len(everything), 12)
        self.assertLess(len(data), 12)
        self.assertEqual(len(list(data)), len(data))
        self.assertIn("images", repr(data))
        item = everything[-1]
        self.assertEqual(item["index"], 11)
        self.assertEqual(item["image"].shape, (16, 16, 3))
        layers = dict(_core.read_exr(f"{self.folders['colour']}/images/000011.exr"))
        np.testing.assert_array_equal(item["image"][..., 2], layers["B"])
        self.assertEqual(item["albedo"].shape, (3,))
        self.assertTrue((item["g"] == item["g"][0]).all())
        shapes = {
            split: {
                itn.Dataset(self.folders["colour"], split).shape_of(i)
                for i in range(len(itn.Dataset(self.folders["colour"], split)))
            }
            for split in ("train", "test")
        }
        self.assertFalse(shapes["train"] & shapes["test"])
        gray = itn.Dataset(self.folders["gray"])[0]
        self.assertEqual((gray["image"].shape, gray["sigma_t"].shape), ((16, 16), (1,)))

    def test_are_loaded_by_processes(self):
        if torch is None:
            self.skipTest("PyTorch is not installed")
        data = itn.Dataset(self.folders["colour"], "all")
        for context in ("fork", "spawn"):
            loader = torch.utils.data.DataLoader(data, batch_size=4, num_workers=2, multiprocessing_context=context)
            batches = list(loader)
            self.assertEqual([tuple(batch["image"].shape) for batch in batches], 3 * [(4, 16, 16, 3)])
            np.testing.assert_array_equal(batches[1]["albedo"][2], data[6]["albedo"])

    def test_say_what_is_wrong(self):
        with self.assertRaisesRegex(itn.FileError, "nowhere"):
            itn.Dataset("nowhere")
        with self.assertRaisesRegex(itn.InvalidInput, "split"):
            itn.Dataset(self.folders["gray"], "all of it")
        with self.assertRaises(IndexError):
            itn.Dataset(self.folders["gray"], "all")[12]


if __name__ == "__main__":
    unittest.main()
