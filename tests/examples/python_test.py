"""The Python package against the library that SLIDE_LIBRARY names, from the folder PYTHONPATH names.

Exits with 77, which stands for "skipped", where there is no NumPy.
"""

import os
import pathlib
import subprocess
import sys
import tempfile
import threading
import unittest

try:
    import numpy as np
except ImportError:
    print("python_test.py: skipped, there is no NumPy")
    sys.exit(77)

import slide

WIDTH, HEIGHT = 48, 32


def scene():
    """A checkered wall behind a disc, its colours and its disparity."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    disc = (x - 24) ** 2 + (y - 16) ** 2 < 80
    rgb = np.stack([np.where(disc, 230, 26), np.where((x // 8 + y // 8) % 2 == 0, 153, 77), x * 5], axis=2)
    return rgb.astype(np.uint8), disc.astype(np.float32)


def model(**settings):
    return slide.Model(depth_weights="formula", inpaint_weights="formula", depth_side=64, **settings)


class Depth(unittest.TestCase):
    def test_layouts_are_one_image(self):
        rgb, _ = scene()
        networks = model()
        depth = networks.disparity(rgb)
        self.assertEqual(depth.shape, (HEIGHT, WIDTH))
        self.assertEqual(depth.dtype, np.float32)
        self.assertTrue(0.98 <= depth.max() <= 1)
        self.assertTrue(0 <= depth.min() <= 0.02)
        wide = np.zeros((HEIGHT, WIDTH + 5, 3), np.uint8)
        wide[:, :WIDTH] = rgb
        for same in (np.float32(rgb) / np.float32(255), rgb / 255.0, wide[:, :WIDTH], np.dstack([rgb, rgb[..., :1]]),
                     np.asfortranarray(rgb), rgb[::-1].copy()[::-1]):
            np.testing.assert_array_equal(networks.disparity(same), depth)
        with self.assertRaises(TypeError):
            networks.disparity(rgb.astype(np.int64))
        with self.assertRaises(ValueError):
            networks.disparity(rgb[..., :2])

    def test_log_tells_what_was_prepared_before(self):
        lines = []
        networks = model(log=lines.append)
        networks.prepare(WIDTH, HEIGHT)
        networks.disparity(scene()[0])
        self.assertEqual(len(lines), 1)
        self.assertIn("prepared before", lines[0])

    def test_two_models_in_two_threads(self):
        rgb, _ = scene()
        expected = model().disparity(rgb)
        results = []
        threads = [threading.Thread(target=lambda n=n: results.append(model(threads=n).disparity(rgb)))
                   for n in (1, 3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(len(results), 2)
        for result in results:
            np.testing.assert_array_equal(result, expected)


class Photos(unittest.TestCase):
    def setUp(self):
        self.rgb, self.disparity = scene()
        self.photo = model().photo(self.rgb, disparity=self.disparity, frames=3)

    def test_maps(self):
        self.assertEqual((self.photo.width, self.photo.height), (WIDTH, HEIGHT))
        np.testing.assert_array_equal(self.photo.map("disparity"), self.disparity)
        np.testing.assert_allclose(self.photo.map("front_colour"), self.rgb / 255.0, atol=1e-6)
        hole = self.photo.map("hole")
        self.assertEqual(set(np.unique(hole)), {0.0, 1.0})
        self.assertTrue((self.photo.map("background_disparity") <= self.photo.map("front_disparity")).all())
        self.assertIsNone(self.photo.map("matte"))
        with self.assertRaises(ValueError):
            self.photo.map("no such map")

    def test_views(self):
        straight = self.photo.render()
        self.assertEqual(straight.dtype, np.uint8)
        corner = np.s_[:4, :4]  # off the outline the photo itself
        self.assertLessEqual(np.abs(straight[corner].astype(int) - self.rgb[corner]).max(), 1)
        # 0.1 to the right at depth 1 and f = 48 pixels: the disc's left edge comes from 15.1 to 10.3.
        moved = self.photo.render((0.1, 0, 0), dtype=np.float32)
        self.assertAlmostEqual(float(moved[16, 12, 0]), 230 / 255, delta=0.02)
        views = self.photo.views
        self.assertEqual(len(views), 3)
        self.assertAlmostEqual(views[0].translation[0], -0.04 / 0.9, places=5)
        self.assertEqual(self.photo.render(views[1], width=24, height=16).shape, (16, 24, 3))
        still = model().photo(self.rgb, disparity=self.disparity, views=[slide.View(
            rotation=(1, 0, 0, 0, 1, 0, 0, 0, 1), zoom=1)])
        self.assertIsNone(still.map("background_colour"))

    def test_files(self):
        with tempfile.TemporaryDirectory() as folder:
            page = pathlib.Path(folder) / "photo.html"
            self.photo.save(page, title="A disc")
            self.assertEqual(page.read_bytes(), self.photo.encode("html", title="A disc"))
            foreign = pathlib.Path(folder) / "foreign.gif"
            foreign.write_bytes(b"of somebody else")
            with self.assertRaises(slide.Error) as caught:
                self.photo.save(foreign)
            self.assertEqual(caught.exception.status, 2)
            self.assertIn("foreign.gif", str(caught.exception))
            still = model().photo(self.rgb, disparity=self.disparity, frames=1).encode("png")
            again = model().photo(still, frames=3)
            self.assertEqual((again.width, again.height), (WIDTH, HEIGHT))
            picture = pathlib.Path(folder) / "photo.png"
            picture.write_bytes(still)
            np.testing.assert_array_equal(model().photo(picture, frames=3).map("disparity"), again.map("disparity"))

    def test_the_example(self):
        with tempfile.TemporaryDirectory() as folder:
            picture = pathlib.Path(folder) / "photo.png"
            picture.write_bytes(self.photo.encode("png", width=64, height=64))
            example = pathlib.Path(slide.__file__).resolve().parent.parent / "example.py"
            subprocess.run([sys.executable, str(example), str(picture), folder], check=True, stdout=subprocess.DEVNULL)
            self.assertGreater((pathlib.Path(folder) / "photo.html").stat().st_size, 5000)
            self.assertTrue((pathlib.Path(folder) / "strip.ppm").read_bytes().startswith(b"P6\n96 16\n255\n"))


class Problems(unittest.TestCase):
    def test_errors_have_status_and_message(self):
        for settings, status in (({"inpaint_weights": "none.safetensors"}, 4), ({"max_side": 1}, 2),
                                 ({"precision": "fp7"}, 2)):
            with self.subTest(**settings), self.assertRaises(slide.Error) as caught:
                slide.Model(depth_weights="formula", **settings)
            self.assertEqual(caught.exception.status, status)
        with self.assertRaises(slide.Error) as caught:
            model().photo("none.jpg")
        self.assertEqual(caught.exception.status, 3)
        closed = model()
        closed.close()
        with self.assertRaises(slide.Error):
            closed.disparity(scene()[0])

    def test_callbacks_stop_and_raise(self):
        rgb, _ = scene()
        with self.assertRaises(slide.Error) as caught:
            model(progress=lambda stage, part: False).disparity(rgb)
        self.assertEqual(caught.exception.status, 130)

        def fail(stage, part):
            raise KeyError(stage)

        with self.assertRaises(KeyError):
            model(progress=fail).disparity(rgb)

    def test_the_version_is_the_projects(self):
        self.assertEqual(slide.version(), os.environ["SLIDE_VERSION"])


if __name__ == "__main__":
    unittest.main()
