"""Gradients through PyTorch: against finite differences, in all kinds of numbers."""

import pathlib
import unittest

import numpy as np

try:
    import torch
except ImportError as error:
    raise unittest.SkipTest("PyTorch is not installed") from error
import itn
import itn.torch

EXAMPLES = pathlib.Path(__file__).resolve().parents[2] / "client/examples"
CUBE = itn.load(EXAMPLES / "cube.textproto").resized(12)


def tensor(value):
    return torch.tensor(value, dtype=torch.float64, requires_grad=True)


class Gradients(unittest.TestCase):
    def test_are_those_of_finite_differences(self):
        """Of a weighted sum of pixels, in each number: z of their difference, for five numbers."""
        values = {"sigma_t": 8.0, "albedo": 0.9, "g": 0.4, "light[0].scale": 1.5, "surface[0].reflectance": 0.5}
        steps = {"sigma_t": 0.4, "albedo": 0.01, "g": 0.05, "light[0].scale": 0.1, "surface[0].reflectance": 0.05}
        weights = torch.from_numpy(np.random.default_rng(1).random((12, 12), dtype=np.float32))
        runs, spp = 24, 512

        def total(numbers, seed):
            return (weights * itn.torch.render(CUBE, numbers, spp=spp, seed=seed)).sum()

        gradients = []
        for seed in range(runs):
            numbers = {name: tensor(value) for name, value in values.items()}
            total(numbers, 1000 + seed).backward()
            gradients.append([numbers[name].grad.item() for name in values])
        gradients = np.array(gradients)
        for column, name in enumerate(values):
            # The same paths on both sides, so that their noise cancels.
            differences = np.array(
                [
                    (
                        total({**values, name: values[name] + steps[name]}, seed)
                        - total({**values, name: values[name] - steps[name]}, seed)
                    ).item()
                    / (2 * steps[name])
                    for seed in range(runs)
                ]
            )
            error = np.hypot(gradients[:, column].std(ddof=1), differences.std(ddof=1)) / np.sqrt(runs)
            difference = gradients[:, column].mean() - differences.mean()
            with self.subTest(name):
                self.assertLess(abs(difference), 4 * error)  # one in 3,000 for five numbers
                self.assertLess(error, 0.1 * abs(differences.mean()))

    def test_are_in_colour(self):
        albedo, scale = tensor([0.9, 0.8, 0.6]), tensor(1.0)
        image = itn.torch.render(CUBE, {"sigma_t": 8, "albedo": albedo, "light[0].scale": scale}, spp=64)
        self.assertEqual(tuple(image.shape), (12, 12, 3))
        image[..., 1].sum().backward()
        self.assertEqual(albedo.grad[0], 0)
        self.assertGreater(albedo.grad[1], 0)
        # Twice the light is twice the image: the derivative in its scale is the image.
        self.assertAlmostEqual(scale.grad.item() / image[..., 1].sum().item(), 1, delta=0.1)

    def test_have_samples_of_their_own(self):
        def gradient(**options):
            albedo = tensor(0.9)
            itn.torch.render(CUBE, {"sigma_t": 8, "albedo": albedo}, spp=16, **options).sum().backward()
            return albedo.grad.item()

        self.assertEqual(gradient(), gradient())
        self.assertNotEqual(gradient(), gradient(seed_grad=0))
        self.assertNotEqual(gradient(), gradient(spp_grad=64))
        self.assertEqual(gradient(seed_grad=3), gradient(seed_grad=3, seed=5))

    def test_come_in_batches(self):
        sigma_t, g = tensor([4.0, 8.0, 16.0]), tensor(0.3)
        images = itn.torch.render_batch(CUBE, {"sigma_t": sigma_t, "albedo": 0.9, "g": g.expand(3)}, spp=16, seed=5)
        self.assertEqual(tuple(images.shape), (3, 12, 12))
        images.sum().backward()
        one, g_of_one = tensor(8.0), tensor(0.3)
        image = itn.torch.render(CUBE, {"sigma_t": one, "albedo": 0.9, "g": g_of_one}, spp=16, seed=6)
        self.assertTrue(torch.equal(image, images[1]))
        image.sum().backward()
        self.assertEqual(one.grad, sigma_t.grad[1])
        self.assertNotEqual(g_of_one.grad, 0)
        self.assertNotEqual(g.grad, g_of_one.grad)

    def test_take_the_medium_of_the_scene(self):
        held = CUBE.to_dict()
        held["object"]["material"] = [{"sigma_t": 8, "albedo": 0.9, "g": 0.3}]
        scale = tensor(1.0)
        image = itn.torch.render(held, {"light[0].scale": scale}, spp=16)
        self.assertTrue(torch.equal(image, itn.torch.render(CUBE, {"sigma_t": 8, "albedo": 0.9, "g": 0.3}, spp=16)))
        held["object"].update(material=[], medium={"name": "marble"})
        images = itn.torch.render_batch(held, {"light[0].scale": torch.ones(2)}, spp=4)
        self.assertEqual(tuple(images.shape), (2, 12, 12))

    def test_lead_to_the_material(self):
        target = torch.from_numpy(itn.render(CUBE, sigma_t=8, albedo=0.8, spp=4096, seed=77).image)
        logit = tensor(0.0)
        optimizer = torch.optim.Adam([logit], lr=0.2)
        for step in range(40):
            optimizer.zero_grad()
            image = itn.torch.render(CUBE, {"sigma_t": 8, "albedo": torch.sigmoid(logit)}, spp=32, seed=step)
            (image - target).square().mean().backward()
            optimizer.step()
        self.assertAlmostEqual(torch.sigmoid(logit).item(), 0.8, delta=0.05)

    def test_say_what_is_wrong(self):
        for message, numbers in {
            "albedo is missing": {"sigma_t": 1},
            "one number": {"sigma_t": torch.ones(2), "albedo": 0.5},
            "here sigma_t, albedo and g": {"sigma_t": 1, "albedo": 0.5, "sigma_a": 1},
            "is not a parameter": {"sigma_t": 1, "albedo": 0.5, "x": 1},
            "albedo is 2": {"sigma_t": 1, "albedo": 2},
        }.items():
            with self.subTest(message), self.assertRaisesRegex(itn.InvalidInput, message):
                itn.torch.render(CUBE, numbers)
        with self.assertRaisesRegex(itn.InvalidInput, "how many images"):
            itn.torch.render_batch(CUBE, {"sigma_t": torch.ones(2), "albedo": torch.ones(3)})
        with self.assertRaises(RuntimeError):  # no second derivatives
            albedo = tensor(0.9)
            image = itn.torch.render(CUBE, {"sigma_t": 8, "albedo": albedo}, spp=4)
            (first,) = torch.autograd.grad(image.sum(), albedo, create_graph=True)
            first.backward()


if __name__ == "__main__":
    unittest.main()
