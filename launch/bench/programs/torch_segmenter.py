"""Train here, benchmark here: a small network for classes of pixels, on a machine with a GPU.

    gantry dataset make launch/datasets/city.toml --out city          # or recordings of your own
    python torch_segmenter.py train --minutes 10 drive.mcap…          # writes torch_segmenter.pt
    gantry bench perception SUITE.toml -- python torch_segmenter.py

Needs `pip install torch`. Recordings need `rgb` and `semantic` of `ego/front` (not
recorded with --jpeg or --video, which keep no pixels). Settings: `device`
("cuda" if there is one), `weights` (beside this file).
"""

import argparse
import pathlib
import sys
import time

import gantry
import gantry.bench
import numpy as np
import torch
from torch import nn

WEIGHTS = pathlib.Path(__file__).with_suffix(".pt")
N_CLASSES = len(gantry.CLASS_NAMES)
#: Sides of images are made multiples of this: the network halves them three times.
MULTIPLE = 8


def block(n_in, n_out, stride=1):
    layers = [nn.Conv2d(n_in, n_out, 3, stride, 1, bias=False), nn.BatchNorm2d(n_out), nn.ReLU(inplace=True)]
    return nn.Sequential(*layers, nn.Conv2d(n_out, n_out, 3, 1, 1, bias=False), nn.BatchNorm2d(n_out), nn.ReLU(inplace=True))


class Segmenter(nn.Module):
    """Three steps down, three up, with the finer image beside each step (0.5 million weights)."""

    def __init__(self, width=24):
        super().__init__()
        sizes = [width, 2 * width, 3 * width, 4 * width]
        self.down = nn.ModuleList([block(3, sizes[0]), *(block(a, b, 2) for a, b in zip(sizes, sizes[1:]))])
        self.up = nn.ModuleList([block(a + b, b) for a, b in zip(sizes[:0:-1], sizes[-2::-1])])
        self.last = nn.Conv2d(width, N_CLASSES, 1)

    def forward(self, image):
        steps = []
        for part in self.down:
            image = part(image)
            steps.append(image)
        for part, finer in zip(self.up, steps[-2::-1]):
            image = part(torch.cat([nn.functional.interpolate(image, scale_factor=2.0), finer], dim=1))
        return self.last(image)


def tensor(bgra, device):
    """An image (h, w, 4) uint8 as (1, 3, h', w') float, with sides that the network can halve."""
    height, width = (side // MULTIPLE * MULTIPLE for side in bgra.shape[:2])
    rgb = np.ascontiguousarray(bgra[:height, :width, 2::-1])
    return torch.from_numpy(rgb).to(device).permute(2, 0, 1)[None].float() / 127.5 - 1.0


def train(recordings, minutes, device):
    images, labels = [], []
    for path in recordings:
        for row in gantry.Recording(path).sync(["ego/front/rgb", "ego/front/semantic"]):
            images.append(tensor(row["ego/front/rgb"].array, "cpu")[0].half())
            labels.append(torch.from_numpy(row["ego/front/semantic"].copy()[: images[-1].shape[1], : images[-1].shape[2]]))
    if not images:
        raise SystemExit("the recordings hold no ticks with ego/front/rgb and ego/front/semantic; record both modalities of the camera")
    frequent = torch.bincount(torch.cat([label.flatten() for label in labels]).long(), minlength=N_CLASSES).float()
    weights = 1.0 / torch.log(1.1 + frequent / frequent.sum())  # rare classes count more (Paszke et al. 2016)
    network = Segmenter().to(device).train()
    optimizer = torch.optim.AdamW(network.parameters(), lr=2e-3, weight_decay=1e-4)
    began, n = time.monotonic(), 0
    while (share := (time.monotonic() - began) / (60.0 * minutes)) < 1.0:
        optimizer.param_groups[0]["lr"] = 2e-3 * (1.0 - share) + 1e-5
        chosen = np.random.default_rng(n).choice(len(images), min(8, len(images)), replace=False)
        batch = torch.stack([images[i] for i in chosen]).to(device).float()
        wanted = torch.stack([labels[i] for i in chosen]).to(device).long()
        if n % 2:
            batch, wanted = batch.flip(-1), wanted.flip(-1)
        loss = nn.functional.cross_entropy(network(batch), wanted, weight=weights.to(device))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        n += 1
        if n % 100 == 0:
            print(f"{n} steps, {60.0 * minutes * share:.0f} s, loss {loss.item():.3f}", flush=True)
    torch.save(network.state_dict(), WEIGHTS)


class Semantic(gantry.bench.Program):
    inputs = {"image": "ego/front/rgb"}
    outputs = ("torch/semantic", "semantic")

    def warm_up(self):
        settings = gantry.bench.params()
        self.device = settings.get("device", "cuda" if torch.cuda.is_available() else "cpu")
        self.network = Segmenter().to(self.device).eval()
        self.network.load_state_dict(torch.load(settings.get("weights", WEIGHTS), map_location=self.device, weights_only=True))
        for _ in range(5):  # the first runs choose algorithms and compile kernels
            self.classes(np.zeros((384, 640, 4), np.uint8))

    @torch.inference_mode()
    def classes(self, bgra):
        return self.network(tensor(bgra, self.device)).argmax(dim=1)[0].byte().cpu().numpy()

    def work(self, image):
        found = self.classes(image.array)
        height, width = image.array.shape[:2]
        return np.pad(found, ((0, height - found.shape[0]), (0, width - found.shape[1])), mode="edge")


if __name__ == "__main__":
    if sys.argv[1:2] == ["train"]:
        parser = argparse.ArgumentParser(description="Trains the network on recordings.")
        parser.add_argument("--minutes", type=float, default=10.0)
        parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
        parser.add_argument("recordings", nargs="+")
        words = parser.parse_args(sys.argv[2:])
        train(words.recordings, words.minutes, words.device)
    else:
        gantry.bench.run(Semantic())
