"""Opens what the perception benchmark writes with programs of others.

    schema SCHEMA DOCUMENTS   JSON Schema: jsonschema, lines {"name", "document", "valid"}
    page FOLDER               HTML: html5lib and xml.etree, pictures: Pillow
    hgrm FOLDER               percentile files: HdrHistogram for Python
    coco FOLDER               truth.json and results.json: pycocotools
    bootstrap FILE            intervals: scipy.stats.bootstrap

Prints what it found, a line each; ends with an error at the first thing that is wrong.
"""

import base64
import io
import json
import pathlib
import re
import sys
import xml.etree.ElementTree as ElementTree


def schema(schema_file: str, documents_file: str) -> None:
    import jsonschema

    text = json.loads(pathlib.Path(schema_file).read_text())
    kind = jsonschema.Draft202012Validator
    kind.check_schema(text)
    validator = kind(text)
    n_without = [name for name, part in text["$defs"].items() if "description" not in part]
    assert not n_without, f"types without a description: {n_without}"
    lines = pathlib.Path(documents_file).read_text().splitlines()
    for line in lines:
        case = json.loads(line)
        errors = [f"{error.json_path}: {error.message}" for error in validator.iter_errors(case["document"])]
        assert bool(errors) != case["valid"], f"{case['name']}: {errors or 'it is valid'}"
    print(f"validated {len(lines)} documents")


def page(folder: str) -> None:
    import html5lib
    from PIL import Image

    text = (pathlib.Path(folder) / "report.html").read_text()
    tree = html5lib.HTMLParser(strict=True, namespaceHTMLElements=False).parse(text)
    # Nothing comes from elsewhere, and nothing is run.
    without_pictures = re.sub(r"data:image/jpeg;base64,[A-Za-z0-9+/=]+", "", text)
    elsewhere = re.search(r"https?:|//[a-z]|<script|<link|<iframe|@import|url\(|\son[a-z]+=", without_pictures)
    assert not elsewhere, f"something from elsewhere: {elsewhere}"
    policy = tree.find(".//meta[@http-equiv]").attrib["content"]
    assert policy.startswith("default-src 'none'"), policy
    ids = [element.attrib["id"] for element in tree.iter() if isinstance(element.tag, str) and "id" in element.attrib]
    assert len(ids) == len(set(ids)), "an id stands twice"
    for link in tree.iter("a"):
        assert link.attrib["href"].removeprefix("#") in ids, link.attrib
    pictures = list(tree.iter("img"))
    for picture in pictures:
        assert picture.attrib["alt"]
        data = picture.attrib["src"].removeprefix("data:image/jpeg;base64,")
        Image.open(io.BytesIO(base64.b64decode(data, validate=True))).verify()
    plots = re.findall(r"<svg .*?</svg>", text, flags=re.DOTALL)
    for plot in plots:
        root = ElementTree.fromstring(plot)
        assert root.attrib["role"] == "img" and root.attrib["aria-label"]
        _, _, width, height = map(float, root.attrib["viewBox"].split())
        for element in root.iter():
            for name in ("x", "x1", "x2", "y", "y1", "y2"):
                value = element.attrib.get(name)
                limit = width if name.startswith("x") else height
                assert value is None or -1 <= float(value) <= limit + 1, f"{name}={value} lies outside"
    for table in tree.iter("table"):
        n_heads = len(table.findall("./thead/tr/th"))
        for row in table.findall("./tbody/tr"):
            assert len(row) == n_heads, f"{len(row)} cells under {n_heads} heads"
    print(f"{len(plots)} plots, {len(pictures)} pictures, {len(list(tree.iter('table')))} tables")
    words = " ".join(" ".join(tree.find("body").itertext()).split())
    print(words)


def hgrm(folder: str) -> None:
    from hdrh.histogram import HdrHistogram

    folder = pathlib.Path(folder)
    report = json.loads((folder / "report.json").read_text())
    n_files = 0
    for run in report["runs"]:
        for kind, spread in run["latency"].items():
            if not spread["n"]:
                continue
            oracle = HdrHistogram.decode(spread["histogram"])
            assert oracle.get_total_count() == spread["n"]
            recorded = [(item.value_iterated_to, item.total_count_to_this_value) for item in oracle.get_recorded_iterator()]

            def is_at(quantile: float, value: float) -> bool:
                """Whether the value has this quantile, or the rank beside it: there are several rules."""
                rank = quantile * spread["n"]
                low, high = (value_at(recorded, beside) for beside in (int(rank - 1e-6), int(rank + 1)))
                return low * 0.999 <= value <= high * 1.001

            for quantile, key in [(0.5, "p50"), (0.9, "p90"), (0.99, "p99"), (0.999, "p999"), (1, "max")]:
                assert is_at(quantile, spread[key]), (kind, key, spread[key])
            lines = (folder / "latency" / f"{file_stem(run)}-{kind}.hgrm").read_text().splitlines()
            assert lines[0].split() == ["Value", "Percentile", "TotalCount", "1/(1-Percentile)"]
            rows = [line.split() for line in lines[1:] if line and not line.startswith("#")]
            for value, quantile, count, *inverse in rows:
                value, quantile = float(value), float(quantile)
                assert is_at(quantile, value), (kind, value, quantile)
                below = [total for at, total in recorded if at / 1e6 <= value * (1 + 1e-6)]
                assert int(count) == (below[-1] if below else 0), (value, count, below[-1:])
                assert not inverse or abs(float(inverse[0]) - 1 / (1 - quantile)) <= 0.01
            assert float(rows[-1][1]) == 1 and int(rows[-1][2]) == spread["n"]
            footer = " ".join(lines[-3:])
            mean, total = re.search(r"#\[Mean += +([\d.]+),", footer), re.search(r"Total count += +(\d+)\]", footer)
            assert abs(float(mean[1]) - oracle.get_mean_value() / 1e6) <= 1e-3 * float(mean[1])
            assert int(total[1]) == spread["n"]
            n_files += 1
    assert n_files == len(list((folder / "latency").glob("*.hgrm")))
    print(f"{n_files} percentile files")


def value_at(recorded: list, rank: int) -> float:
    """The value of this rank, milliseconds."""
    found = (at for at, total in recorded if total >= rank)
    return next(found, recorded[-1][0]) / 1e6


def file_stem(run: dict) -> str:
    mode = run["mode"] if run["mode"] != "stress" else "constant" if run["speed"] else "single"
    label = f"{run['program']} {mode}"
    if run["mode"] != "offline" and run["speed"] not in (0.0, 1.0):
        label += f" {run['speed']:g}x"
    return re.sub(r"[^A-Za-z0-9._-]", "-", label)


def coco(folder: str) -> None:
    from pycocotools.coco import COCO
    from pycocotools.cocoeval import COCOeval

    for task, kind in [("boxes2d", "bbox"), ("masks", "segm")]:
        truth = COCO(pathlib.Path(folder, "coco", task, "truth.json"))
        for results in sorted(pathlib.Path(folder, "coco", task).glob("*/results.json")):
            judge = COCOeval(truth, truth.loadRes(str(results)), kind)
            judge.evaluate()
            judge.accumulate()
            judge.summarize()
            print(f"FOUND {task} {results.parent.name} AP {judge.stats[0]:.6f} AP50 {judge.stats[1]:.6f}")


def bootstrap(file: str) -> None:
    import numpy
    import scipy.stats

    cases = json.loads(pathlib.Path(file).read_text())
    worst, ours, theirs = 0.0, 0, 0
    for at, case in enumerate(cases):
        sample, (low, high) = numpy.array(case["sample"]), case["interval"]
        found = scipy.stats.bootstrap(
            (sample,), numpy.mean, n_resamples=case["resamples"], confidence_level=case["confidence"], method="percentile", random_state=at
        ).confidence_interval
        width = found.high - found.low
        worst = max(worst, abs(low - found.low) / width, abs(high - found.high) / width)
        ours += low <= case["mean"] <= high
        theirs += found.low <= case["mean"] <= found.high
    print(f"worst end differs by {worst:.4f} of the width")
    print(f"coverage {ours / len(cases):.4f} and {theirs / len(cases):.4f}")


globals()[sys.argv[1]](*sys.argv[2:])
