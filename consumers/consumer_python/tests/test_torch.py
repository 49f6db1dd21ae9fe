"""Data sets for torch: numbers, classes and errors without it, and tensors and spawned workers where it is installed."""

import importlib.util
import json
import pathlib
import pickle
import sys
import tempfile
import unittest

import numpy as np
from PIL import Image

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "python"))

import gantry  # noqa: E402
import gantry.torch  # noqa: E402

#: Boxes [x, y, w, h] and COCO's categories, by picture.
BOXES = [[([1, 2, 3, 4], 3), ([0, 0, 2, 2], 1)], [], [([4, 1, 2, 5], 3)]]


def write_set(folder):
    """A set of three pictures of 8×6 pixels, of which picture i is of the colour (10 i, 20 i, 30 i)."""
    (folder / "annotations").mkdir()
    (folder / "images" / "train").mkdir(parents=True)
    images, annotations = [], []
    # In another order than that of their numbers, as COCO allows.
    for i in (2, 0, 1):
        name = f"{i}.png"
        Image.new("RGB", (8, 6), (10 * i, 20 * i, 30 * i)).save(folder / "images" / "train" / name)
        images.append({"id": i + 1, "file_name": name, "width": 8, "height": 6})
        for box, category in BOXES[i]:
            annotations.append({"id": len(annotations) + 1, "image_id": i + 1, "category_id": category, "bbox": box, "area": box[2] * box[3]})
    whole = {"images": images, "annotations": annotations, "categories": []}
    (folder / "annotations" / "instances_train.json").write_text(json.dumps(whole))


class Sets(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.path = pathlib.Path(cls.folder.name)
        write_set(cls.path)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def test_pictures_and_boxes_are_those_of_their_number(self):
        made = gantry.torch.Dataset(self.path, min_pixels=1)
        self.assertEqual(len(made), 3)
        for i in range(3):
            found = made.sample(i)
            self.assertEqual(found.image.shape, (3, 6, 8))
            self.assertEqual(found.image[:, 5, 7].tolist(), [10 * i, 20 * i, 30 * i])
            self.assertEqual(found.boxes.tolist(), [[x, y, x + w, y + h] for (x, y, w, h), _ in BOXES[i]])
            self.assertEqual([made.classes[label] for label in found.labels], [{1: "person", 3: "car"}[category] for _, category in BOXES[i]])
        self.assertEqual(made.sample(-1).boxes.tolist(), made.sample(2).boxes.tolist())
        with self.assertRaises(IndexError):
            made.sample(3)

    def test_sources_are_numbered_on_and_classes_are_chosen(self):
        made = gantry.torch.Dataset(self.path, self.path, classes=["car"], min_pixels=11)
        self.assertEqual(len(made), 6)
        # The box of 3×4 is left, that of 5×2 has ten pixels, and the person is none.
        self.assertEqual([made.sample(i).labels.tolist() for i in range(6)], [[0], [], [], [0], [], []])

    def test_a_set_travels_to_another_process_with_its_numbers(self):
        made = gantry.torch.Dataset(self.path, classes=["person", "car"], min_pixels=1)
        other = pickle.loads(pickle.dumps(made))
        for i in range(3):
            for one, same in zip(made.sample(i), other.sample(i)):
                np.testing.assert_array_equal(one, same)

    def test_what_cannot_be_is_said(self):
        for error, words, make in [
            (ValueError, "'lorry'; there is person, bicycle", lambda: gantry.torch.Dataset(self.path, classes=["lorry"])),
            (ValueError, "nothing to read", lambda: gantry.torch.Dataset()),
            (ValueError, "it must be float32 or uint8", lambda: gantry.torch.Dataset(self.path, dtype="float64")),
            (gantry.GantryError, "has the parts train; give one of them as part=, not 'val'", lambda: gantry.torch.Dataset(self.path, part="val")),
            (gantry.GantryError, "has no folder annotations", lambda: gantry.torch.Dataset(self.path / "images")),
            (gantry.GantryError, "none.mcap", lambda: gantry.torch.Dataset(self.path / "none.mcap")),
        ]:
            with self.subTest(words), self.assertRaises(error) as raised:
                make()
            self.assertIn(words, str(raised.exception))


if importlib.util.find_spec("torch") is None:

    class WithoutTorch(Sets):
        def test_the_first_image_asks_for_torch(self):
            with self.assertRaises(ImportError) as raised:
                gantry.torch.Dataset(self.path)[0]
            self.assertIn("pip install torch", str(raised.exception))

else:
    import torch

    class WithTorch(Sets):
        def test_images_and_targets_are_tensors_as_torchvision_takes_them(self):
            image, target = gantry.torch.Dataset(self.path, min_pixels=1, first_label=1)[2]
            self.assertEqual((image.dtype, tuple(image.shape)), (torch.float32, (3, 6, 8)))
            self.assertAlmostEqual(float(image[2, 0, 0]), 60 / 255, places=6)
            self.assertEqual((target["boxes"].dtype, target["boxes"].tolist()), (torch.float32, [[4.0, 1.0, 6.0, 6.0]]))
            self.assertEqual((target["labels"].dtype, target["labels"].tolist()), (torch.int64, [3]))
            whole, _ = gantry.torch.Dataset(self.path, dtype="uint8")[2]
            self.assertEqual((whole.dtype, whole[:, 0, 0].tolist()), (torch.uint8, [20, 40, 60]))

        def test_spawned_workers_give_what_this_process_gives(self):
            made = gantry.torch.Dataset(self.path, min_pixels=1)
            batches = list(gantry.torch.loader(made, 2, workers=2))
            self.assertEqual([tuple(images.shape) for images, _ in batches], [(2, 3, 6, 8), (1, 3, 6, 8)])
            targets = [target for _, targets in batches for target in targets]
            self.assertEqual([target["image_id"] for target in targets], [0, 1, 2])
            for i, target in enumerate(targets):
                self.assertTrue(torch.equal(target["boxes"], made[i][1]["boxes"]))


if __name__ == "__main__":
    unittest.main()
