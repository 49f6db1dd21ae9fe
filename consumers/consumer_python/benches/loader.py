"""How fast a set is loaded: gantry.torch.loader beside torchvision's plain loader of the same files, by turns.

    gantry export drive.mcap --format coco --images jpg --out set        # images of 800 x 600
    python loader.py set --json loader.json

Both decode the same JPEG files with Pillow in as many spawned workers, make a float tensor (3, h, w) of each, and hand over
batches with boxes. Prints images a second of each round, and the middle of their ratio. Needs torch and torchvision.
"""

import argparse
import json
import pathlib
import statistics
import time

import gantry.torch
import torch
import torchvision


class Plain(torchvision.datasets.CocoDetection):
    """What a user writes with torchvision alone."""

    def __init__(self, folder, part):
        super().__init__(f"{folder}/images/{part}", f"{folder}/annotations/instances_{part}.json", transform=torchvision.transforms.ToTensor())

    def __getitem__(self, i):
        image, found = super().__getitem__(i)
        corners = torch.tensor([it["bbox"] for it in found], dtype=torch.float32).reshape(-1, 4)
        corners[:, 2:] += corners[:, :2]
        return image, {"boxes": corners, "labels": torch.tensor([it["category_id"] for it in found], dtype=torch.int64)}


def images_a_second(loader):
    """One pass over the set; workers have started before."""
    n, began = 0, time.perf_counter()
    for images, _ in loader:
        n += len(images)
    return n / (time.perf_counter() - began)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set")
    parser.add_argument("--part", default="train")
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", type=pathlib.Path)
    words = parser.parse_args()
    options = {"workers": words.workers, "shuffle": True}
    loaders = {
        "gantry": gantry.torch.loader(gantry.torch.Dataset(words.set, part=words.part), words.batch, **options),
        "torchvision": gantry.torch.loader(Plain(words.set, words.part), words.batch, **options),
    }
    for loader in loaders.values():
        images_a_second(loader)
    rates = {name: [] for name in loaders}
    for _ in range(words.rounds):
        for name, loader in loaders.items():
            rates[name].append(images_a_second(loader))
            print(f"{name}: {rates[name][-1]:.1f} images/s", flush=True)
    ratio = statistics.median(a / b for a, b in zip(rates["gantry"], rates["torchvision"]))
    print(f"gantry / torchvision: {ratio:.2f}")
    if words.json:
        rows = [{"name": name, "images_per_s": statistics.median(all_of_it)} for name, all_of_it in rates.items()]
        made = {"rows": rows, "ratio": ratio, "torch": torch.__version__, "torchvision": torchvision.__version__, "workers": words.workers}
        words.json.write_text(json.dumps(made, indent=2) + "\n")
