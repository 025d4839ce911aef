"""Renders by workers: the bits of this process, by one relay that is kept, and clear errors."""

import concurrent.futures
import multiprocessing
import os
import pathlib
import select
import signal
import subprocess
import sys
import tempfile
import unittest
import warnings

import itn
import numpy as np
from itn import programs, workers

try:
    import itn.torch
    import torch
except ImportError:
    torch = None

EXAMPLES = pathlib.Path(__file__).resolve().parents[2] / "client/examples"
CUBE = itn.load(EXAMPLES / "cube.textproto").resized(24)
MEDIUM = {"sigma_t": 20, "albedo": 0.8, "g": 0.3}
ENDLESS = {"sigma_t": 200, "albedo": 0.999, "spp": 1 << 20}
FIELDS = ("image", "stderr", "mask", "derivatives", "derivative_stderr", "estimates", "derivative_estimates")


class ByWorkers(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = cls.enterClassContext(tempfile.TemporaryDirectory())
        cls.address = f"unix:{cls.folder}/w"
        cls.worker = subprocess.Popen(
            [programs.find("itn-worker"), "--listen", cls.address],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        cls.worker.stdout.readline()

    @classmethod
    def tearDownClass(cls):
        cls.worker.terminate()
        with cls.worker:
            pass

    def test_have_the_same_bits(self):
        names = ["g", "surface[0].reflectance"]
        for options in (
            {**MEDIUM, "estimates": 2},
            {"sigma_t": 20, "albedo": [0.9, 0.8, 0.6]},
            {"medium": itn.materials()["marble"]},
            {**MEDIUM, "colour": False},
            {**MEDIUM, "phase": None, "pixels": "object", "tracer": "reference"},
            {"sigma_t": 20, "albedo": np.array([0.9, 0.8, 0.6]), "values": {"light[0].scale": np.float64(1.5)}},
        ):
            there, here = (
                itn.render(CUBE, **options, spp=9, seed=3, derivatives=names, workers=by) for by in (self.address, None)
            )
            self.assertEqual(there.materials, here.materials)
            for field in FIELDS:
                held, expected = getattr(there, field), getattr(here, field)
                if not isinstance(held, dict):
                    held, expected = {field: held}, {field: expected}
                self.assertEqual(held.keys(), expected.keys())
                for name in held:
                    np.testing.assert_array_equal(held[name], expected[name], field)

    def test_have_goals_and_say_how_far_they_are(self):
        said = []
        render = itn.render(CUBE, **MEDIUM, noise=0.05, workers=[self.address], progress=said.append)
        self.assertLessEqual(render.noise, 0.05)
        self.assertEqual(said[-1], 1)

    def test_come_many_at_a_time(self):
        many = dict(
            itn.render_many({"scene": CUBE, **MEDIUM, "spp": 4, "workers": self.address, "seed": i} for i in range(3))
        )
        for i in range(3):
            np.testing.assert_array_equal(many[i].image, itn.render(CUBE, **MEDIUM, spp=4, seed=i).image)

    @unittest.skipIf(torch is None, "PyTorch is not installed")
    def test_have_the_same_gradients(self):
        def image_and_gradients(by):
            albedo = torch.tensor([[0.9, 0.8, 0.6], [0.7, 0.5, 0.3]], dtype=torch.float64, requires_grad=True)
            scale = torch.tensor([1.0, 2.0], dtype=torch.float64, requires_grad=True)
            images = itn.torch.render_batch(
                CUBE, {"sigma_t": 8, "albedo": albedo, "light[0].scale": scale}, spp=8, workers=by
            )
            one = itn.torch.render(CUBE, {"sigma_t": 8, "albedo": 0.5, "light[0].scale": scale[0]}, spp=8, workers=by)
            (images.square().sum() + one.square().sum()).backward()
            return images.detach().numpy(), one.detach().numpy(), albedo.grad.numpy(), scale.grad.numpy()

        for there, here in zip(image_and_gradients(self.address), image_and_gradients(None)):
            np.testing.assert_array_equal(there, here)

    def test_keep_one_relay_as_long_as_it_lives(self):
        itn.render(CUBE, **MEDIUM, spp=1, workers=self.address)
        kept = list(workers._idle)
        itn.render(CUBE, **MEDIUM, spp=1, workers=self.address)
        self.assertEqual(workers._idle, kept)
        for relay in kept:
            relay._child.kill()
            relay._child.wait()
        itn.render(CUBE, **MEDIUM, spp=1, workers=self.address)
        self.assertNotIn(workers._idle[-1], kept)

    def test_say_why_the_worker_refuses(self):
        with self.assertRaisesRegex(itn.InvalidInput, "albedo"):
            itn.render(CUBE, sigma_t=1, albedo=1.5, workers=self.address)
        for wrong in ([], "", [self.address, ""], f"{self.address},", 5, [None], {"a": 1}):
            with self.subTest(wrong), self.assertRaisesRegex(itn.InvalidInput, "^workers .*'host:50051'"):
                itn.render(CUBE, **MEDIUM, workers=wrong)
        for wrong in ("--help", "file:"):
            with self.subTest(wrong), self.assertRaisesRegex(itn.InvalidInput, wrong):
                itn.render(CUBE, **MEDIUM, workers=wrong)
        with self.assertRaisesRegex(itn.Unavailable, "127.0.0.1:1"):
            itn.render(CUBE, **MEDIUM, workers="127.0.0.1:1")

    def test_are_cancelled(self):
        stop = itn.Stop()
        with self.assertRaises(itn.Cancelled):
            itn.render(CUBE, **ENDLESS, workers=self.address, stop=stop, progress=lambda _: stop.request())
        itn.render(CUBE, **MEDIUM, spp=1, workers=self.address)  # and the worker is free

    def test_say_what_they_wait_for(self):
        class Enough(Exception):
            pass

        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")

            def give_up_when_said(_):
                if caught:
                    raise Enough

            with self.assertRaises(Enough):
                itn.render(CUBE, **MEDIUM, workers=f"file:{folder}/none", progress=give_up_when_said)
        self.assertRegex(str(caught[0].message), "^there are no render workers; waiting .*no such file yet")

    def test_warn_once_and_in_whole_lines(self):
        """Of what many threads look for, and what comes in halves."""
        itn.render(CUBE, **MEDIUM, spp=1, workers=self.address)
        relay = workers._idle[-1]

        def log(text):
            os.pwrite(relay._messages.fileno(), text.encode(), os.fstat(relay._messages.fileno()).st_size)

        line = "2026-01-01 00:00:00.000 warning {}\n".format
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            log(line(-1)[:20])
            relay.warn()
            log(line(-1)[20:])
            with concurrent.futures.ThreadPoolExecutor(8) as pool:
                for i in range(100):
                    log(line(i))
                    for done in [pool.submit(relay.warn) for _ in range(8)]:
                        done.result()
        self.assertEqual([str(warning.message) for warning in caught], [str(i) for i in range(-1, 100)])

    def test_end_though_a_fork_lives(self):
        """A process that was forked while another thread asked does not hold the relay."""
        code = (
            "import itn, os, threading, time\n"
            "def forked(_):\n"
            "  if not pids:\n"
            "    pids.append(os.fork())\n"
            "    if pids[0] == 0: time.sleep(1000)\n"
            "    print(list(itn.workers._all)[0]._child.pid, pids[0], flush=True)\n"
            "pids = []\n"
            f"itn.render({str(EXAMPLES / 'cube.textproto')!r}, **{ENDLESS}, workers={self.address!r}, progress=forked)\n"
        )
        with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as child:
            relay, fork = map(int, child.stdout.readline().split())
            try:
                ended = os.pidfd_open(relay)
                child.kill()
                self.assertEqual(select.select([ended], [], [], 60)[0], [ended])
                os.close(ended)
            finally:
                os.kill(fork, signal.SIGKILL)

    def test_are_asked_for_by_forked_processes(self):
        expected = itn.render(CUBE, **MEDIUM, spp=1, workers=self.address).image
        with multiprocessing.get_context("fork").Pool(2) as pool:
            for image in pool.map(render_by, [self.address] * 2):
                np.testing.assert_array_equal(image, expected)
        np.testing.assert_array_equal(render_by(self.address), expected)

    def test_are_interrupted(self):
        code = (
            f"import itn\ndef say(_): print('begun', flush=True)\n"
            f"try:\n  itn.render({str(EXAMPLES / 'cube.textproto')!r}, **{ENDLESS}, workers={self.address!r}, progress=say)\n"
            "except KeyboardInterrupt:\n  print('interrupted')"
        )
        with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as child:
            self.assertIn("begun", child.stdout.readline())
            child.send_signal(signal.SIGINT)
            self.assertIn("interrupted\n", child.stdout.read())

    def test_end_with_a_process_that_is_killed(self):
        """Nobody else has the relay's socket: it ends, and with it the pipe that it has from here."""
        code = (
            f"import itn\nitn.render({str(EXAMPLES / 'cube.textproto')!r}, sigma_t=1, albedo=.5, spp=1, workers={self.address!r})\n"
            "print(itn.workers._idle[0]._child.pid, flush=True)\nimport time\ntime.sleep(1000)"
        )
        with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as child:
            relay = int(child.stdout.readline())
            ended = os.pidfd_open(relay)
            child.kill()
            self.assertEqual(select.select([ended], [], [], 60)[0], [ended])
            os.close(ended)


def render_by(address):
    return itn.render(CUBE, **MEDIUM, spp=1, workers=address).image


if __name__ == "__main__":
    unittest.main()
