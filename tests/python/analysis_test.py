"""Materials from images in Python, through the programs."""
import pathlib
import tempfile
import unittest
import warnings

import itn
import numpy as np
from itn import programs

EXAMPLES = pathlib.Path(__file__).resolve().parents[2] / "client/examples"


class Analyses(unittest.TestCase):
    def setUp(self):
        warnings.simplefilter("ignore")

    def test_read_a_photograph(self):
        answer = itn.predict(EXAMPLES / "mug.jpg", mask=EXAMPLES / "mug_mask.png", object_size=95)
        self.assertEqual(answer.albedo.shape, (3,))
        for name in ("sigma_t", "albedo", "g", "sigma_s_reduced", "diffuse_albedo", "diffusion_length"):
            low, high = answer.interval(name).T
            self.assertTrue((low <= high).all(), name)
        self.assertIn("encoded", " ".join(answer.remarks))
        self.assertIn("90 %", repr(answer))
        with tempfile.TemporaryDirectory() as folder:
            answer.write(f"{folder}/mug.mtlx")
            self.assertIn("<materialx", (pathlib.Path(folder) / "mug.mtlx").read_text())
            with self.assertRaisesRegex(itn.InvalidInput, ".mtlx"):
                answer.write(f"{folder}/mug.txt")

    def test_read_an_array(self):
        done = itn.render(EXAMPLES / "cube.textproto", sigma_t=10, albedo=[.9, .8, .6], spp=64, resolution=64)
        answer = itn.predict(done.image, mask=done.mask)
        self.assertEqual(answer.sigma_t.shape, (3,))
        with self.assertRaisesRegex(itn.InvalidInput, "linear radiance"):
            itn.predict(np.zeros((8, 8, 3), np.uint8))

    def test_find_the_material_of_a_render(self):
        scene = itn.load(EXAMPLES / "cube.textproto").resized(48)
        done = itn.render(scene, sigma_t=20, albedo=.8, g=.3, spp=256)
        answer = itn.refine(done.image, scene, time_limit=15)
        self.assertFalse(answer.misfit)
        self.assertLess(abs(answer.albedo[0] - .8), .05)
        self.assertEqual(answer.percent, 95)
        with tempfile.TemporaryDirectory() as folder:
            answer.write(f"{folder}/cube.xml")
            self.assertIn("homogeneous", (pathlib.Path(folder) / "cube.xml").read_text())

    def test_say_what_is_wrong(self):
        with self.assertRaisesRegex(itn.FileError, "nowhere.jpg"):
            itn.predict("nowhere.jpg")
        with self.assertRaisesRegex(itn.InvalidInput, "did you mean --object-size"):
            itn.predict(EXAMPLES / "mug.jpg", objectsize=3)
        with self.assertRaisesRegex(itn.InvalidInput, "object-size is required"):
            itn.fit(EXAMPLES / "mug.jpg", shape="cube")
        with self.assertRaisesRegex(itn.InvalidInput, "shape"):
            itn.refine(np.zeros((4, 4, 7), np.float32), EXAMPLES / "cube.textproto")


class Flags(unittest.TestCase):
    def test_are_those_of_the_command_line(self):
        self.assertEqual(programs.arguments({"object_size": 82, "matt": True, "quiet": False, "mask": None,
                                             "gray_card": (1, 2, 3, 4), "index": 1.5, "panorama_turn": np.array([1.5, 2])}),
                         ["--object-size", "82", "--matt", "--gray-card", "1,2,3,4", "--index", "1.5", "--panorama-turn",
                          "1.5,2.0"])


if __name__ == "__main__":
    unittest.main()
