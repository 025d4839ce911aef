"""Renders in processes that are forked, spawned, and interrupted; and what the module brings into a process."""

import multiprocessing
import os
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import threading
import unittest

import itn
import numpy as np
from itn import _core

EXAMPLES = pathlib.Path(__file__).resolve().parents[2] / "client/examples"


def render(seed):
    scene = itn.load(EXAMPLES / "cube.textproto").resized(16)
    return itn.render(scene, sigma_t=20, albedo=0.8, spp=8, seed=seed).image


class Processes(unittest.TestCase):
    def test_render_the_same_forked_and_spawned(self):
        expected = [render(seed) for seed in range(4)]
        for method in ("fork", "spawn", "forkserver"):
            with self.subTest(method), multiprocessing.get_context(method).Pool(2) as pool:
                np.testing.assert_array_equal(pool.map(render, range(4)), expected)

    def test_refuse_to_render_where_the_parent_rendered(self):
        stop, begun = itn.Stop(), threading.Event()
        scene = itn.load(EXAMPLES / "cube.textproto")

        def endless():
            try:
                itn.render(scene, sigma_t=200, albedo=0.999, spp=1 << 20, stop=stop, progress=lambda _: begun.set())
            except itn.Cancelled:
                pass

        thread = threading.Thread(target=endless)
        thread.start()
        begun.wait()
        child = os.fork()
        if child == 0:
            code = 1
            try:
                itn.render(scene, sigma_t=2, albedo=0.9, spp=1)
            except itn.Error as error:
                code = 0 if "spawn" in str(error) else 2
            finally:
                os._exit(code)
        _, status = os.waitpid(child, 0)
        stop.request()
        thread.join()
        self.assertEqual(os.waitstatus_to_exitcode(status), 0)

    def test_are_interrupted(self):
        for code in (
            "itn.render(scene, sigma_t=200, albedo=.999, spp=1 << 20, progress=say)",
            "list(itn.render_many({'scene': scene, 'sigma_t': 200, 'albedo': .999, 'spp': 1 << 20, 'progress': say}"
            " for _ in range(4)))",
        ):
            child = subprocess.Popen(
                [
                    sys.executable,
                    "-c",
                    f"import itn\nscene = itn.load({str(EXAMPLES / 'cube.textproto')!r})\n"
                    f"def say(_): print('begun', flush=True)\ntry:\n  {code}\nexcept KeyboardInterrupt:\n  print('interrupted')",
                ],
                stdout=subprocess.PIPE,
                text=True,
            )
            with self.subTest(code), child:
                self.assertIn("begun", child.stdout.readline())
                child.send_signal(signal.SIGINT)
                self.assertIn("interrupted\n", child.stdout.read())
                self.assertEqual(child.wait(), 0)

    def test_end_with_python(self):
        """Threads that render are no reason to abort, or to wait."""
        endless = "sigma_t=200, albedo=.999, spp=1 << 20"
        begin = f"import itn, threading\nscene = itn.load({str(EXAMPLES / 'cube.textproto')!r})\nbegun = threading.Event()\n"
        for code in (
            f"threading.Thread(target=lambda: itn.render(scene, {endless}, progress=lambda _: begun.set()), daemon=True).start()\n"
            "begun.wait()",
            "def small():\n  while True: itn.render(scene, sigma_t=9, albedo=.5, spp=1); begun.set()\n"
            "threading.Thread(target=small, daemon=True).start(); begun.wait()",
            f"many = itn.render_many([dict(scene=scene, sigma_t=9, albedo=.5, spp=1)] + 3 * [dict(scene=scene, {endless})])\n"
            "next(many)",
        ):
            with self.subTest(code):
                done = subprocess.run(
                    [sys.executable, "-c", begin + code], stderr=subprocess.PIPE, text=True, timeout=60
                )
                self.assertEqual(done.returncode, 0, done.stderr)


class Module(unittest.TestCase):
    def test_links_no_grpc_torch_or_openmp(self):
        linked = subprocess.run(["ldd", _core.__file__], check=True, capture_output=True, text=True).stdout
        self.assertIn("libembree", linked)
        self.assertIsNone(re.search(r"grpc|torch|gomp|omp5", linked))

    def test_shows_no_names_but_its_own(self):
        shown = subprocess.run(
            ["nm", "-DC", "--defined-only", _core.__file__], check=True, capture_output=True, text=True
        ).stdout
        self.assertEqual([line.split()[-1] for line in shown.splitlines()], ["PyInit__core"])

    def test_leaves_room_for_the_stubs_of_protoc(self):
        with tempfile.TemporaryDirectory() as folder:
            (pathlib.Path(folder) / "itn/v1").mkdir(parents=True)
            (pathlib.Path(folder) / "itn/v1/render_pb2.py").write_text("NAME = 'render'")
            code = f"import sys; sys.path.insert(0, {folder!r}); from itn.v1 import render_pb2; import itn; itn.render"
            subprocess.run([sys.executable, "-c", code], check=True)

    def test_imports_no_torch(self):
        subprocess.run([sys.executable, "-c", "import sys, itn; assert 'torch' not in sys.modules"], check=True)


if __name__ == "__main__":
    unittest.main()
