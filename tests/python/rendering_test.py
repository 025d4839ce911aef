"""Renders in Python: the bits of the program's, arrays that are one's own, and clear errors."""

import pathlib
import subprocess
import tempfile
import threading
import unittest
import warnings

import itn
import numpy as np
from itn import _core, programs

EXAMPLES = pathlib.Path(__file__).resolve().parents[2] / "client/examples"
CUBE = itn.load(EXAMPLES / "cube.textproto").resized(24)
MEDIUM = {"sigma_t": 20, "albedo": 0.8, "g": 0.3}


class Renders(unittest.TestCase):
    def layers_of_program(self, *flags):
        with tempfile.TemporaryDirectory() as folder:
            path = f"{folder}/image.exr"
            subprocess.run(
                [
                    programs.find("itn"),
                    "render",
                    EXAMPLES / "cube.textproto",
                    "-o",
                    path,
                    "--resolution",
                    "24",
                    "--quiet",
                    *flags,
                ],
                check=True,
                stdout=subprocess.DEVNULL,
            )
            return dict(_core.read_exr(path))

    def test_are_those_of_the_program_bit_for_bit(self):
        layers = self.layers_of_program(
            "--sigma-t",
            "20",
            "--albedo",
            "0.8",
            "--g",
            "0.3",
            "--spp",
            "50",
            "--seed",
            "7",
            "--derivatives",
            "sigma_t,surface[0].reflectance",
            "--estimates",
            "2",
        )
        names = ["sigma_t", "surface[0].reflectance"]
        done = itn.render(CUBE, **MEDIUM, spp=50, seed=7, derivatives=names, estimates=2)
        np.testing.assert_array_equal(done.image, layers["Y"])
        np.testing.assert_array_equal(done.stderr, layers["stderr.Y"])
        np.testing.assert_array_equal(done.mask, layers["mask.Y"])
        np.testing.assert_array_equal(done.estimates[1], layers["estimate1.Y"])
        for name in names:
            np.testing.assert_array_equal(done.derivatives[name], layers[f"{name}.Y"])
            np.testing.assert_array_equal(done.derivative_stderr[name], layers[f"stderr.{name}.Y"])
            np.testing.assert_array_equal(done.derivative_estimates[name][1], layers[f"estimate1.{name}.Y"])

    def test_are_in_colour_by_three_numbers(self):
        layers = self.layers_of_program(
            "--sigma-t", "20", "--albedo", "0.9,0.8,0.5", "--spp", "16", "--derivatives", "albedo"
        )
        done = itn.render(CUBE, sigma_t=20, albedo=np.array([0.9, 0.8, 0.5]), spp=16, derivatives="albedo")
        self.assertEqual(done.image.shape, (24, 24, 3))
        for c, name in enumerate("RGB"):
            np.testing.assert_array_equal(done.image[..., c], layers[name])
            np.testing.assert_array_equal(done.derivatives["albedo"][..., c], layers[f"albedo.{name}"])
        self.assertEqual([m[1] for m in done.materials], [0.9, 0.8, 0.5])

    def test_take_values_of_the_scene_and_measured_media(self):
        self.assertGreater(
            itn.render(CUBE, **MEDIUM, values={"light[0].scale": 2}, spp=8).image.sum(),
            1.9 * itn.render(CUBE, **MEDIUM, spp=8).image.sum(),
        )
        marble = itn.materials()["marble"]
        done = itn.render(CUBE.to_dict(), medium=marble, object_size=10, spp=8, colour=True, resolution=(24, 24))
        self.assertEqual([m[1] for m in done.materials], list(marble.albedo))
        np.testing.assert_allclose([m[0] for m in done.materials], 10 * np.array(marble.sigma_t))

    def test_end_when_they_are_good_enough(self):
        done = itn.render(CUBE, **MEDIUM, noise=0.2)
        self.assertLessEqual(done.noise, 0.2)
        self.assertGreater(done.noise, 0.1)
        self.assertLess(itn.render(CUBE, **MEDIUM, time=0.2).seconds, 60)

    def test_say_that_they_did_not_get_there(self):
        with self.assertWarnsRegex(UserWarning, "the noise is .*, not 0.1 %"):
            itn.render(CUBE, **MEDIUM, noise=0.001, spp=64, estimates=16)
        stop = itn.Stop()
        with self.assertRaises(itn.Cancelled):
            itn.render(CUBE, **MEDIUM, noise=1e-6, stop=stop, progress=lambda part: part < 0.5 or stop.request())

    def test_are_of_the_luminance_without_colour(self):
        gray = itn.render(CUBE.coloured(), **MEDIUM, spp=8, colour=False)
        np.testing.assert_array_equal(gray.image, itn.render(CUBE.coloured(False), **MEDIUM, spp=8).image)
        self.assertEqual(itn.render(CUBE.coloured(), **MEDIUM, spp=8).image.shape, (24, 24, 3))

    def test_hand_on_what_ends_them(self):
        def progress(_):
            raise SystemExit(3)

        with self.assertRaises(SystemExit):
            list(itn.render_many([{"scene": CUBE, **MEDIUM, "spp": 4, "progress": progress}]))

    def test_give_arrays_that_are_the_callers(self):
        first, second = (itn.render(CUBE, **MEDIUM, spp=4, derivatives=["g"]) for _ in range(2))
        for array in (first.image, first.derivatives["g"], first.mask, first.stderr):
            self.assertEqual(array.dtype, np.float32)
            self.assertTrue(array.flags.writeable)
            array[:] = 7
        np.testing.assert_array_equal(np.from_dlpack(first.image), first.image)
        self.assertTrue((first.image == 7).all())
        self.assertFalse((second.image == 7).any())
        held = itn.render(CUBE, **MEDIUM, spp=4, derivatives=["g"]).image  # outlives its render
        np.testing.assert_array_equal(held, second.image)

    def test_are_seen_and_written(self):
        done = itn.render(CUBE, **MEDIUM, spp=4, derivatives=["g"])
        self.assertTrue(done._repr_png_().startswith(b"\x89PNG"))
        self.assertIn("24 x 24", repr(done))
        self.assertEqual(done.picture("g").enlarged(2).pixels.shape, (48, 48, 3))
        self.assertEqual(itn.row(done.picture(), done.picture("g").enlarged(2)).pixels.shape, (48, 72, 3))
        with self.assertRaisesRegex(itn.InvalidInput, "albedo is none"):
            done.picture("albedo")
        with tempfile.TemporaryDirectory() as folder:
            done.write(f"{folder}/a.exr")
            done.write(f"{folder}/a.png")
            layers = dict(_core.read_exr(f"{folder}/a.exr"))
            np.testing.assert_array_equal(layers["Y"], done.image)
            np.testing.assert_array_equal(layers["g.Y"], done.derivatives["g"])
            self.assertEqual(len(list(pathlib.Path(folder).iterdir())), 2)

    def test_come_many_at_a_time(self):
        requests = [{"scene": CUBE, **MEDIUM, "spp": 4, "seed": i} for i in range(9)]
        done = dict(itn.render_many(requests))
        self.assertEqual(sorted(done), list(range(9)))
        for i in (0, 8):
            np.testing.assert_array_equal(done[i].image, itn.render(**requests[i]).image)
        with self.assertRaisesRegex(itn.InvalidInput, "request 9: material.albedo"):
            list(itn.render_many([*requests, {"scene": CUBE, "sigma_t": 1, "albedo": 2}]))
        for wrong in ([{"sigma_t": 1}], [1], {"scene": CUBE}):
            with self.assertRaisesRegex(itn.InvalidInput, "request"):
                list(itn.render_many(wrong))
        endless = ({"scene": CUBE, **MEDIUM, "spp": 4, "seed": i} for i in range(1 << 40))
        for number, _ in itn.render_many(endless):
            if number >= 5:
                break

    def test_say_what_is_wrong(self):
        for message, wrong in {
            "material.albedo is 2": {"albedo": 2},
            "material.sigma_t is -1": {"sigma_t": -1},
            "sigma_t .* are both required": {"sigma_t": None},
            "give a measured medium, or numbers": {"medium": "marble"},
            "albedo nan": {"albedo": float("nan")},
            "three of red": {"albedo": [1, 2]},
            "spp 0": {"spp": 0},
            "seed -1": {"seed": -1},
            "estimates 17": {"estimates": 17},
            "tracer": {"tracer": "fast"},
            "nonsense is not a parameter": {"derivatives": ["nonsense"]},
            "light\\[7\\]": {"values": {"light[7].scale": 1}},
            "noise 0": {"noise": 0},
            "pilot": {"noise": 0.1, "pilot_spp": 2},
            "threads 0": {"threads": 0},
            "phase": {"phase": "one_term {}", "g": None},
            "resolution 'big'": {"resolution": "big"},
            "colour=False": {"albedo": [0.9, 0.8, 0.7], "colour": False},
            "sigma_t is of the medium": {"values": {"sigma_t": 8}},
            "pixels None": {"pixels": None},
            "stop 1": {"stop": 1},
            "values .* dictionary": {"values": [1]},
            "sigma_t '5'": {"sigma_t": "5"},
            "phase 5": {"phase": 5, "g": None},
            "width True": {"resolution": True},
            "65535": {"resolution": 70000},
        }.items():
            with self.subTest(message), self.assertRaisesRegex(ValueError, message):
                itn.render(CUBE, **{**MEDIUM, **wrong})
        for wrong in ("milk", ""):
            with self.assertRaisesRegex(itn.InvalidInput, "measured medium"):
                itn.render(CUBE, medium=wrong)
        with self.assertRaisesRegex(itn.InvalidInput, "ends in .exr"):
            itn.render(CUBE, **MEDIUM, spp=1).write("cube.jpg")
        for name in ("cube.exr", "cube.png"):
            with self.assertRaisesRegex(itn.FileError, f"/nowhere/{name}(?!.*part)"):
                itn.render(CUBE, **MEDIUM, spp=1).write(f"/nowhere/{name}")
        with self.assertRaisesRegex(itn.InvalidInput, "what itn.load"):
            itn.render(5, **MEDIUM)
        with self.assertRaisesRegex(itn.LimitExceeded, "pixels"):
            itn.render(CUBE.resized(60000), **MEDIUM)
        with self.assertRaises(TypeError):
            itn.render(CUBE, sigma=3)

    def test_warn_where_the_caller_is(self):
        held = CUBE.to_dict()
        held["camera"]["target"] = {"x": 1000}
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            itn.render(itn.scene(held), **MEDIUM, spp=1)
        self.assertIn("does not see the object", str(said[0].message))
        self.assertEqual(said[0].filename, __file__)

    def test_are_cancelled_from_another_thread(self):
        stop = itn.Stop()
        begun = threading.Event()
        errors = []

        def render():
            try:
                itn.render(CUBE, sigma_t=200, albedo=0.999, spp=1 << 20, stop=stop, progress=lambda _: begun.set())
            except itn.Cancelled as error:
                errors.append(error)

        thread = threading.Thread(target=render)
        thread.start()
        begun.wait()
        stop.request()
        thread.join()
        self.assertEqual(len(errors), 1)

    def test_give_up_where_progress_raises(self):
        def progress(_):
            raise RuntimeError("enough")

        with self.assertRaisesRegex(RuntimeError, "enough"):
            itn.render(CUBE, sigma_t=200, albedo=0.999, spp=1 << 20, progress=progress)


if __name__ == "__main__":
    unittest.main()
