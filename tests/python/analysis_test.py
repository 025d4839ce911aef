"""Materials from images in Python, through the programs."""

import copy
import gc
import os
import pathlib
import pickle
import tempfile
import unittest
import unittest.mock
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

    def test_read_arrays_and_renders(self):
        done = itn.render(EXAMPLES / "cube.textproto", sigma_t=10, albedo=[0.9, 0.8, 0.6], spp=64, resolution=64)
        answers = [
            itn.predict(done.image, mask=mask)
            for mask in (done.mask, done.mask > 0.5, (255 * (done.mask > 0.5)).astype(np.uint8))
        ]
        answers.append(itn.predict(done.image.astype(np.float64), mask=(done.mask > 0.5).tolist()))
        for answer in answers:
            np.testing.assert_allclose(answer.albedo, answers[1].albedo, rtol=0.02)
        self.assertEqual(itn.predict(done, frame="object").sigma_t.shape, (3,))
        both = itn.predict([EXAMPLES / "knot_1.jpg", EXAMPLES / "knot_2.jpg"], mask=EXAMPLES / "knot_masks")
        self.assertEqual(both.albedo.shape, (3,))
        with self.assertRaisesRegex(itn.InvalidInput, "image: it is a file"):
            itn.predict(None)
        with self.assertRaisesRegex(itn.InvalidInput, "image: it has numbers that are not finite"):
            itn.predict(np.full((8, 8), np.nan))
        with self.assertRaisesRegex(itn.InvalidInput, "linear radiance"):
            itn.predict(np.zeros((8, 8, 3), np.uint8))

    def test_read_many(self):
        done = itn.render(EXAMPLES / "cube.textproto", sigma_t=10, albedo=[0.9, 0.8, 0.6], spp=64, resolution=64)
        dark = np.zeros((32, 32), np.float32)
        found = itn.predict_many(
            [done.image, dark, EXAMPLES / "mug.jpg"], masks=[done.mask, dark + 1, EXAMPLES / "mug_mask.png"]
        )
        self.assertIsInstance(found[1], itn.Error)
        np.testing.assert_array_equal(found[0].albedo, itn.predict(done.image, mask=done.mask).albedo)
        np.testing.assert_array_equal(
            found[2].albedo, itn.predict(EXAMPLES / "mug.jpg", mask=EXAMPLES / "mug_mask.png").albedo
        )
        many = itn.predict_many(11 * [dark], masks=11 * [dark + 1])
        self.assertRegex(str(many[10]), "^the mask mask 10 covers")
        self.assertEqual(itn.predict_many([]), [])
        with self.assertRaisesRegex(itn.InvalidInput, "1, and 2"):
            itn.predict_many([done, done], masks=[done.mask])

    def test_find_the_material_of_a_render(self):
        scene = itn.load(EXAMPLES / "cube.textproto").resized(48)
        done = itn.render(scene, sigma_t=20, albedo=0.8, g=0.3, spp=256)
        said = []
        answer = copy.deepcopy(itn.refine(done, scene.to_dict(), max_iterations=10, progress=said.append))
        self.assertEqual([one["iteration"] for one in said], list(range(1, len(said) + 1)))
        self.assertEqual(said, answer.trajectory)
        self.assertAlmostEqual(said[-1]["materials"][0]["albedo"], answer.albedo[0], delta=0.05)
        self.assertFalse(answer.misfit)
        self.assertLess(abs(answer.albedo[0] - 0.8), 0.05)
        self.assertEqual(answer.percent, 95)
        with tempfile.TemporaryDirectory() as folder:
            pickle.loads(pickle.dumps(answer)).write(f"{folder}/cube.xml")
            self.assertIn("homogeneous", (pathlib.Path(folder) / "cube.xml").read_text())

    def test_end_where_progress_raises_and_go_on(self):
        def stop(_):
            raise StopIteration

        done = itn.render(EXAMPLES / "cube.textproto", sigma_t=20, albedo=0.8, spp=64, resolution=32)
        with tempfile.TemporaryDirectory() as folder:
            arguments = {"output": f"{folder}/out", "max_iterations": 6}
            scene = itn.load(EXAMPLES / "cube.textproto").resized(32)
            with self.assertRaises(StopIteration):
                itn.refine(done, scene, progress=stop, **arguments)
            begun = len(pathlib.Path(folder, "out/trajectory.jsonl").read_text().splitlines())
            said = []
            answer = itn.refine(done, scene, progress=said.append, **arguments)
            self.assertEqual(len(said), len(answer.trajectory) - begun)

    def test_find_materials_of_images_in_colour(self):
        scene = itn.load(EXAMPLES / "cube.textproto").resized(32)
        done = itn.render(scene, sigma_t=20, albedo=[0.9, 0.8, 0.6], g=0.3, spp=256)
        answer = itn.refine(done, scene, max_iterations=10)
        self.assertEqual(answer.albedo.shape, (3,))
        np.testing.assert_allclose(answer.albedo, [0.9, 0.8, 0.6], atol=0.08)

    def test_leave_no_files_behind(self):
        with tempfile.TemporaryDirectory() as folder, unittest.mock.patch.object(tempfile, "tempdir", folder):
            answer = itn.predict(np.ones((32, 32), np.float32), mask=np.pad(np.ones((16, 16)), 8))
            self.assertEqual(len(os.listdir(folder)), 1)
            del answer
            gc.collect()
            self.assertEqual(os.listdir(folder), [])

    def test_say_what_is_wrong(self):
        with self.assertRaisesRegex(itn.FileError, "nowhere.jpg"):
            itn.predict("nowhere.jpg")
        with self.assertRaisesRegex(itn.InvalidInput, "did you mean --object-size"):
            itn.predict(EXAMPLES / "mug.jpg", objectsize=3)
        with self.assertRaisesRegex(itn.InvalidInput, "object-size is required"):
            itn.fit(EXAMPLES / "mug.jpg", shape="cube")
        cube = EXAMPLES / "cube.textproto"
        with self.assertRaisesRegex(itn.InvalidInput, "(4, 4, 7)"):
            itn.refine(np.zeros((4, 4, 7), np.float32), cube)
        with self.assertRaisesRegex(itn.InvalidInput, "there are 3, and 2 images"):
            itn.refine([np.ones((4, 4)), np.ones((4, 4))], 3 * [cube])
        with self.assertRaisesRegex(itn.InvalidInput, "^(?!.*/tmp/itn).*image"):
            itn.refine(np.ones((4, 4)), cube)
        for wrong, says in (
            ({"output": ""}, "output"),
            ({"workers": ","}, "^workers"),
            ({"workers": True}, "^workers"),
        ):
            with self.subTest(wrong), self.assertRaisesRegex(itn.InvalidInput, says):
                itn.refine(np.ones((4, 4)), cube, **wrong)
        with self.assertRaisesRegex(itn.FileError, "mug.jpg"):
            itn.refine(np.ones((128, 128)), cube, output=EXAMPLES / "mug.jpg", mask=np.ones((128, 128)))
        with self.assertRaisesRegex(itn.InvalidInput, "sigma_t, albedo"):
            itn.predict(EXAMPLES / "mug.jpg", mask=EXAMPLES / "mug_mask.png").value("roughness")


class Flags(unittest.TestCase):
    def test_are_those_of_the_command_line(self):
        self.assertEqual(
            programs.arguments(
                {
                    "object_size": 82,
                    "matt": True,
                    "quiet": False,
                    "mask": None,
                    "gray_card": (1, 2, 3, 4),
                    "index": 1.5,
                    "panorama_turn": np.array([1.5, 2]),
                }
            ),
            ["--object-size", "82", "--matt", "--gray-card", "1,2,3,4", "--index", "1.5", "--panorama-turn", "1.5,2.0"],
        )


if __name__ == "__main__":
    unittest.main()
