"""Scenes in Python: what goes in comes out, and what is wrong is said."""

import copy
import os
import pathlib
import pickle
import tempfile
import unittest
import warnings

import itn
import numpy as np
from itn import _core

EXAMPLES = pathlib.Path(__file__).resolve().parents[2] / "client/examples"


class Scenes(unittest.TestCase):
    def setUp(self):
        self.scene = itn.load(EXAMPLES / "cube.textproto")

    def test_are_the_same_as_dictionary_text_file_and_pickle(self):
        self.assertEqual(itn.scene(self.scene.to_dict()), self.scene)
        self.assertEqual(itn.scene(self.scene.to_text()), self.scene)
        self.assertEqual(pickle.loads(pickle.dumps(self.scene)), self.scene)
        self.assertEqual(copy.deepcopy(self.scene), self.scene)
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "scene.textproto"
            self.scene.save(path)
            self.assertEqual(itn.load(path), self.scene)
            self.assertEqual([p.name for p in pathlib.Path(folder).iterdir()], ["scene.textproto"])

    def test_change_by_dictionary(self):
        changed = self.scene.to_dict()
        changed["surfaces"][0]["reflectance"] = 0.25
        other = itn.scene(changed)
        self.assertNotEqual(other, self.scene)
        self.assertEqual(other.parameters()["surface[0].reflectance"].value, 0.25)

    def test_name_their_numbers(self):
        numbers = self.scene.parameters()
        self.assertEqual(numbers["light[0].scale"].value, 1)
        self.assertEqual(numbers["surface[0].reflectance"], (0.5, 0, 1))
        self.assertNotIn("sigma_t", numbers)
        self.assertNotIn("light[1].scale", numbers)

    def test_take_triangles_of_arrays(self):
        corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (0.0, 1.0) for z in (-0.5, 0.5)])
        quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
        held = self.scene.to_dict()
        held["object"]["mesh"] = {"triangles": {"positions": corners, "indices": triangles}}
        scene = itn.scene(held)
        scene.check()
        mask = itn.render(scene, sigma_t=5, albedo=0.9, spp=4, resolution=16).mask
        expected = itn.render(self.scene, sigma_t=5, albedo=0.9, spp=4, resolution=16).mask
        np.testing.assert_array_equal(mask, expected)
        again = scene.to_dict()["object"]["mesh"]["triangles"]
        np.testing.assert_array_equal(again["positions"], corners.astype(np.float32))
        np.testing.assert_array_equal(again["indices"], triangles)
        held["object"]["mesh"]["triangles"] = {"positions": (2 * corners).astype(int), "indices": triangles.tolist()}
        self.assertEqual(itn.render(itn.scene(held), sigma_t=5, albedo=0.9, spp=4, resolution=16).mask.shape, (16, 16))
        for message, wrong in {
            "indices: .* whole numbers from 0": {"indices": triangles - 1},
            "indices: .* whole": {"indices": triangles + 0.5},
            "indices: .* \\(8, 4\\)": {"indices": np.zeros((8, 4), int)},
            "positions: .* \\(8, 2\\)": {"positions": corners[:, :2]},
            "positions: .* numbers": {"positions": [["a", "b", "c"]]},
        }.items():
            spoiled = {"object": {"mesh": {"triangles": {"positions": corners, "indices": triangles, **wrong}}}}
            with self.subTest(message), self.assertRaisesRegex(itn.InvalidInput, message):
                itn.scene(spoiled)

    def test_take_vectors_of_three_numbers_and_paths(self):
        held = self.scene.to_dict()
        held["camera"]["origin"] = [0, 9.28, -32.8]
        held["camera"]["target"] = np.array([0, 0.5, 0])
        self.assertEqual(itn.scene(held), self.scene)
        held["object"]["mesh"] = {"path": pathlib.Path("nowhere.ply")}
        with self.assertRaisesRegex(itn.FileError, "nowhere.ply"):
            itn.scene(held)
        held["camera"]["target"] = [0, float("nan"), 0]
        with self.assertRaisesRegex(itn.InvalidInput, "camera.target.y is nan"):
            itn.scene(held)

    def test_take_panoramas_of_any_numbers(self):
        def image(pixels):
            lights = [{"environment_map": {"pixels": {"width": 2, "height": 1, "rgb": pixels}}}]
            return itn.render(
                {**self.scene.to_dict(), "lights": lights}, sigma_t=5, albedo=0.9, spp=4, resolution=8
            ).image

        expected = image(np.ones((2, 3), np.float32))
        self.assertGreater(expected.mean(), 0)
        for pixels in (np.ones((2, 3), np.uint8), np.ones((2, 3), np.float64), [[1, 1, 1], [1, 1, 1]]):
            np.testing.assert_array_equal(image(pixels), expected)

    def test_have_another_size(self):
        scene = self.scene.resized(20, 10)
        self.assertEqual((scene.width, scene.height), (20, 10))
        self.assertEqual((self.scene.width, self.scene.height), (128, 128))
        for wrong in (0, -1, 1.5, "8"):
            with self.assertRaises(itn.InvalidInput):
                self.scene.resized(wrong)

    def test_warn_of_their_files(self):
        with tempfile.TemporaryDirectory() as folder:
            pixels = np.ones((2, 4), np.float32)
            pixels[0, 0] = -0.001
            _core.write_exr(f"{folder}/room.exr", [("Y", pixels)])
            lights = [{"environment_map": {"path": "room.exr"}}]
            with self.assertWarnsRegex(UserWarning, "room.exr"):
                itn.scene({**self.scene.to_dict(), "lights": lights}, folder=folder)

    def test_go_to_mitsuba_and_back(self):
        """Images are the same within their noise: pixels by five standard errors of one in 1.7 million, their mean by
        four, of one in 16,000."""
        held = self.scene.resized(24, 16).to_dict()
        held["object"]["mesh"]["transforms"] = [{"rotate": {"axis": (0, 1, 0), "angle_degrees": 20}}]
        held["object"]["rough_dielectric"] = {"index": 1.4, "single_scattering": True}
        held["lights"] = [
            {"constant": {"radiance": 0.3}},
            {"directional": {"direction": (1, 2, -1), "irradiance": 2}},
            {"point": {"position": (1, 3, 0), "intensity": 1e-6}},
            {"sphere": {"center": (2, 3, -2), "radius": 0.5, "radiance": 4}, "color": {"blue": 0.5}},
            {"panel": {"center": (-2, 3, 0), "half_u": (1, 0, 0), "half_v": (0, 0, 1), "radiance": 2}},
        ]
        held["surfaces"] = [
            {
                "rectangle": {"half_u": (20, 0, 0), "half_v": (0, 0, -20)},
                "checkerboard": {"corner": (0.3, 0, 0.2), "edge_u": (0.5, 0, 0.2), "edge_v": (-0.1, 0, 0.6)},
            },
            {"mesh": {"builtin": "cube", "transforms": [{"translate": (1.4, 0.2, 0)}]}, "reflectance": 0.3},
        ]
        held["camera"] = {**held["camera"], "principal_x": 0.4, "crop": {"top": 0.2}}
        medium = {"sigma_t": 20, "albedo": 0.8, "g": 0.3}
        for scene in (itn.scene(held), itn.scene(held).coloured()):
            with tempfile.TemporaryDirectory() as folder:
                path = pathlib.Path(folder) / "a & b.xml"
                with warnings.catch_warnings(record=True) as caught:
                    warnings.simplefilter("always")
                    scene.save(path, **medium)
                    back = itn.load(path)
                self.assertEqual(["touches" in str(w.message) for w in caught], [True])
                names = sorted(p.name for p in pathlib.Path(folder).iterdir())
                self.assertEqual(names, ["a & b.xml", "a & b_object.ply", "a & b_surface_1.ply"])
                with self.assertRaisesRegex(itn.InvalidInput, "ends in .xml"):
                    scene.save(pathlib.Path(folder) / "scene.textproto", sigma_t=1)
                with self.assertRaisesRegex(itn.FileError, "absent"):
                    scene.save(pathlib.Path(folder) / "absent/scene.xml", **medium)
            there, here = itn.render(back, spp=256), itn.render(scene, **medium, spp=256, seed=1)
            error = np.hypot(there.stderr, here.stderr)
            difference = there.image - here.image
            self.assertTrue((np.abs(difference) <= 5 * error + 1e-6).all())
            self.assertLess(abs(difference.sum()), 4 * np.sqrt((error**2).sum()))
            self.assertLess(np.sqrt((error**2).sum()), 0.01 * here.image.sum())

    def test_come_back_from_mitsuba_with_their_panorama(self):
        held = self.scene.resized(16).to_dict()
        held["object"]["mesh"]["transforms"] = [{"translate": (0, 0.1, 0)}]
        scene, medium = itn.scene(held), {"sigma_t": 20, "albedo": 0.8}
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("error")
            scene.save(f"{folder}/$a.xml", **medium)
            self.assertIn("_a_panorama.exr", os.listdir(folder))
            back = itn.load(f"{folder}/$a.xml")
            there, here = itn.render(back, spp=1024), itn.render(scene, **medium, spp=1024, seed=1)
            difference = abs(there.image.mean() - here.image.mean())
            error = np.sqrt((there.stderr**2).sum() + (here.stderr**2).sum()) / here.image.size
            self.assertLess(difference, 4 * error)
            self.assertLess(error, 0.01 * here.image.mean())
            os.mkdir(f"{folder}/folder.xml")
            with self.assertRaisesRegex(itn.FileError, "folder.xml"):
                scene.save(f"{folder}/folder.xml", **medium)
            self.assertNotIn("folder_object.ply", os.listdir(folder))
            with self.assertRaisesRegex(itn.InvalidInput, "null"):
                scene.save(f"{folder}/b\0.textproto")
            with self.assertRaisesRegex(itn.InvalidInput, "NUL"):
                itn.load(f"{folder}/$a\0.textproto")
            for path, wrong, says in (
                ("a.xml", {"albedo": 2}, "albedo"),
                ("a.pbrt", {}, "ends in .xml"),
                (os.fsdecode(b"\xff.xml"), {}, "UTF-8"),
                ("a\0.xml", {}, "NUL"),
            ):
                with self.assertRaisesRegex(itn.InvalidInput, says):
                    scene.save(f"{folder}/{path}", **{**medium, **wrong})

    def test_say_what_is_wrong(self):
        with self.assertRaisesRegex(itn.FileError, "nowhere.textproto"):
            itn.load("nowhere.textproto")
        with self.assertRaisesRegex(OSError, "nowhere.textproto"):
            itn.load("nowhere.textproto")
        with self.assertRaisesRegex(itn.InvalidInput, "colour"):
            itn.scene({"colour": 1})
        with self.assertRaisesRegex(itn.InvalidInput, "lihgts"):
            itn.scene("lihgts { }")
        for wrong in ("cube.textproto", EXAMPLES / "cube.textproto"):
            with self.assertRaisesRegex(itn.InvalidInput, "itn.load"):
                itn.scene(wrong)
        with self.assertRaisesRegex(itn.InvalidInput, "itn.scene"):
            itn.load({})
        with self.assertRaisesRegex(itn.FileError, "cannot write /nowhere/a"):
            self.scene.save("/nowhere/a")
        with self.assertRaisesRegex(ValueError, "scene.lights"):
            itn.scene({"object": {"mesh": {"builtin": "cube"}}, "film": {"width": 8, "height": 8}}).check()
        with self.assertRaisesRegex(itn.InvalidInput, "Mitsuba"):
            itn.load(EXAMPLES / "cube.textproto", mm_per_unit=10)

    def test_come_from_mitsuba(self):
        with warnings.catch_warnings(record=True):
            warnings.simplefilter("always")
            scene = itn.load(EXAMPLES / "cube.xml")
        done = itn.render(scene, spp=1, resolution=8)  # of its medium
        self.assertEqual(done.image.shape, (8, 8, 3))
        np.testing.assert_allclose(done.materials, [(12, 0.99, 0.4), (16, 0.97, 0.4), (20, 0.9, 0.4)], rtol=1e-6)
        with self.assertRaises(itn.FileError):
            itn.load("nowhere.xml")


if __name__ == "__main__":
    unittest.main()
