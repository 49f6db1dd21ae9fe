"""A detector that is trained here: recordings or exported sets in, an ONNX file out, and the program that runs it.

    gantry dataset make launch/datasets/detector.toml --out set       # 1000 images of five towns
    python torch_detector.py train --minutes 45 set/coco              # writes torch_detector.onnx; needs torch
    gantry bench perception SUITE.toml -- python torch_detector.py    # needs OpenCV alone

The network marks the middle of each object and says how far its edges are from there (Zhou et al.:
*Objects as Points*, 2019), in cells of 4 pixels. The file beside this one was made so, in 2693 steps
with torch 1.13 on two cores that other work shared; on the part `val` of that set it has an AP of 0.32
for vehicles and of 0.16 for people. Settings: `weights` (beside this file), `least` score.
"""

import argparse
import pathlib
import sys
import time

import gantry
import gantry.bench
import numpy as np

WEIGHTS = pathlib.Path(__file__).with_suffix(".onnx")
CLASSES = ["person", "car", "truck", "bus", "motorcycle", "bicycle"]
#: Pixels of a cell; rows and columns of the parts of images that are trained on; what the sides of images are filled up to.
CELL, CROP, MULTIPLE = 4, (192, 320), 32


def network():
    from torch import nn

    def step(n_in, n_out, stride=1):
        return nn.Sequential(nn.Conv2d(n_in, n_out, 3, stride, 1, bias=False), nn.BatchNorm2d(n_out), nn.ReLU(inplace=True))

    class Detector(nn.Module):
        """Five steps down, three up with the finer image added (0.3 million weights)."""

        def __init__(self, widths=(16, 32, 48, 64, 96), width=40):
            super().__init__()
            pairs = zip((3, *widths), widths)
            self.down = nn.ModuleList([nn.Sequential(step(a, b, 2), *([step(b, b)] if b > 16 else [])) for a, b in pairs])
            self.side = nn.ModuleList([nn.Conv2d(b, width, 1) for b in widths[1:]])
            self.up = nn.ModuleList([step(width, width) for _ in widths[1:]])
            self.heat, self.edges = nn.Conv2d(width, len(CLASSES), 1), nn.Conv2d(width, 4, 1)
            nn.init.constant_(self.heat.bias, -4.6)  # at first each cell is an object with 1 %

        def forward(self, image):
            seen = []
            for part in self.down:
                image = part(image)
                seen.append(image)
            found = None
            for part, side, finer in list(zip(self.up, self.side, seen[1:]))[::-1]:
                wider = 0 if found is None else nn.functional.interpolate(found, scale_factor=2.0)
                found = part(side(finer) + wider)
            return self.heat(found).sigmoid(), self.edges(found).clamp(-4, 5).exp()

    return Detector()


def cut(image, target):
    """A part of an image, mirrored half of the time, with what the network is to say about it."""
    import torch

    draw = np.random.default_rng().random(3)
    top, left = (int(share * (side - part + 1)) for share, side, part in zip(draw, image.shape[1:], CROP))
    image = image[:, top : top + CROP[0], left : left + CROP[1]]
    boxes, labels = target["boxes"].numpy() - np.array([left, top] * 2), target["labels"].numpy()
    whole = np.maximum((boxes[:, 2:] - boxes[:, :2]).prod(axis=1), 1)
    boxes = boxes.clip(0, np.array(CROP[::-1] * 2))
    kept = (boxes[:, 2:] - boxes[:, :2]).clip(0).prod(axis=1) > 0.3 * whole
    boxes, labels = boxes[kept], labels[kept]
    if draw[2] < 0.5:
        image, boxes = image.flip(-1), np.stack([CROP[1] - boxes[:, 2], boxes[:, 1], CROP[1] - boxes[:, 0], boxes[:, 3]], axis=1)
    rows, columns = CROP[0] // CELL, CROP[1] // CELL
    heat, edges, at = np.zeros((len(CLASSES), rows, columns), np.float32), np.zeros((4, rows, columns), np.float32), np.zeros((rows, columns), bool)
    y, x = np.mgrid[:rows, :columns] + 0.5
    for (x0, y0, x1, y1), label in zip(boxes / CELL, labels):
        column, row = min(int((x0 + x1) / 2), columns - 1), min(int((y0 + y1) / 2), rows - 1)
        sigma = max((x1 - x0) / 6, 0.6), max((y1 - y0) / 6, 0.6)
        spot = np.exp(-(((x - column - 0.5) / sigma[0]) ** 2 + ((y - row - 0.5) / sigma[1]) ** 2) / 2)
        heat[label] = np.maximum(heat[label], spot)
        at[row, column] = True
        edges[:, row, column] = column + 0.5 - x0, row + 0.5 - y0, x1 - column - 0.5, y1 - row - 0.5
    return image, {"heat": torch.from_numpy(heat), "edges": torch.from_numpy(edges).clamp(min=0.01), "at": torch.from_numpy(at)}


def loss_of(heat, edges, targets):
    import torch

    wanted, sides, at = (torch.stack([target[name] for target in targets]) for name in ("heat", "edges", "at"))
    heat = heat.clamp(1e-4, 1 - 1e-4)
    is_middle = wanted > 0.999
    found = torch.log(heat) * (1 - heat) ** 2 * is_middle
    missed = torch.log(1 - heat) * heat**2 * (1 - wanted) ** 4 * ~is_middle
    one, other = edges.permute(0, 2, 3, 1)[at], sides.permute(0, 2, 3, 1)[at]
    both = torch.minimum(one, other)
    inside = (both[:, 0] + both[:, 2]) * (both[:, 1] + both[:, 3])
    area = [(it[:, 0] + it[:, 2]) * (it[:, 1] + it[:, 3]) for it in (one, other)]
    overlap = inside / (area[0] + area[1] - inside)
    n = max(int(is_middle.sum()), 1)
    return -(found.sum() + missed.sum()) / n + 2 * (1 - overlap).sum() / n


def train(sources, minutes, out):
    import gantry.torch
    import torch

    data = gantry.torch.Dataset(*sources, classes=CLASSES, part="train", min_pixels=40, transform=cut)
    batches = gantry.torch.loader(data, 16, shuffle=True, drop_last=True, workers=1)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    net = network().to(device).train()
    optimizer = torch.optim.AdamW(net.parameters(), lr=2e-3, weight_decay=1e-4)
    began, n, shown = time.monotonic(), 0, 0.0
    while time.monotonic() - began < 60 * minutes:
        for images, targets in batches:
            share = min((time.monotonic() - began) / (60 * minutes), 1.0)
            optimizer.param_groups[0]["lr"] = 2e-3 * (0.5 + 0.5 * np.cos(np.pi * share)) + 1e-5
            loss = loss_of(*net(images.to(device)), [{name: it.to(device) for name, it in target.items()} for target in targets])
            optimizer.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(net.parameters(), 10.0)
            optimizer.step()
            n, shown = n + 1, shown + loss.item()
            if n % 20 == 0:
                print(f"{n} steps of 16 cuts, {60 * minutes * share:.0f} s, loss {shown / 20:.3f}", flush=True)
                shown = 0.0
            if share == 1.0:
                break
    torch.onnx.export(net.cpu().eval(), torch.zeros(1, 3, 384, 640), str(out), opset_version=11, input_names=["image"], output_names=["heat", "edges"])
    print(f"{out}: {n} steps over {len(data)} images, torch {torch.__version__}")


class Detector(gantry.bench.Program):
    inputs = {"image": "ego/front/rgb"}
    outputs = [gantry.bench.Output("detector/boxes", "boxes2d", classes=CLASSES)]

    def warm_up(self):
        import cv2

        settings = gantry.bench.params()
        self.least = float(settings.get("least", 0.05))
        self.net = cv2.dnn.readNetFromONNX(str(settings.get("weights", WEIGHTS)))
        self.find(np.zeros((3, 384, 640), np.float32))

    def find(self, image):
        """Boxes, scores and classes of an image (3, h, w)."""
        height, width = image.shape[1:]
        self.net.setInput(np.pad(image, ((0, 0), (0, -height % MULTIPLE), (0, -width % MULTIPLE)))[None])
        heat, edges = self.net.forward(["heat", "edges"])
        heat, edges = heat[0], edges[0]
        # A cell counts if none of its neighbours is more of an object.
        padded = np.pad(heat, ((0, 0), (1, 1), (1, 1)))
        n_rows, n_columns = heat.shape[1:]
        near = [padded[:, y : y + n_rows, x : x + n_columns] for y in range(3) for x in range(3)]
        label, row, column = np.nonzero((heat >= np.maximum.reduce(near)) & (heat > self.least))
        middle = np.stack([column, row], axis=1) + 0.5
        sides = edges[:, row, column].T
        return CELL * np.concatenate([middle - sides[:, :2], middle + sides[:, 2:]], axis=1), heat[label, row, column], label

    def work(self, image):
        boxes, scores, classes = self.find(image.tensor(dtype="float32"))
        return gantry.boxes2d(xyxy=boxes, score=scores, class_=classes)


if __name__ == "__main__":
    if sys.argv[1:2] == ["train"]:
        parser = argparse.ArgumentParser(description="Trains the network on recordings and exported sets.")
        parser.add_argument("--minutes", type=float, default=60.0)
        parser.add_argument("--out", type=pathlib.Path, default=WEIGHTS)
        parser.add_argument("sources", nargs="+")
        words = parser.parse_args(sys.argv[2:])
        train(words.sources, words.minutes, words.out)
    else:
        gantry.bench.run(Detector())
