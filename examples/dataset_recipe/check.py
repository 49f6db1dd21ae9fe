"""Reads the set as a training loop would: images, boxes and classes of every part. Ends with code 1 if something is amiss."""

import collections
import json
import pathlib
import sys

folder = pathlib.Path(sys.argv[1])
files = sorted(folder.rglob("instances_*.json"))
n_images = 0
for file in files:
    part = json.loads(file.read_text())
    root = file.parent.parent
    names = {category["id"]: category["name"] for category in part["categories"]}
    sizes = {image["id"]: (image["width"], image["height"]) for image in part["images"]}
    missing = [image["file_name"] for image in part["images"] if not list(root.rglob(pathlib.Path(image["file_name"]).name))]
    if missing:
        sys.exit(f"{file.name} names {missing[0]}, which is not there")
    for annotation in part["annotations"]:
        x, y, width, height = annotation["bbox"]
        right, bottom = sizes[annotation["image_id"]]
        if not (0 <= x and 0 <= y and x + width <= right and y + height <= bottom):
            sys.exit(f"{file.name}: a box leaves its image: {annotation['bbox']}")
    counts = collections.Counter(names[annotation["category_id"]] for annotation in part["annotations"])
    n_images += len(sizes)
    print(f"{file.name}: {len(sizes)} images, " + ", ".join(f"{n} {name}" for name, n in counts.most_common()))
print(f"the set is sound: {n_images} images in {len(files)} parts")
sys.exit(0 if n_images else "the set is empty")
