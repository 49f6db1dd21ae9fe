"""A chain of four Python processes, camera → a → b → c, in Gantry and in other systems, by turns in one run.

Each process takes an image, copies it into an output of its own, and sends that on. The first 16 bytes of an image carry two stamps of
CLOCK_MONOTONIC: when the camera's image was sent, and when this one was. A hop ends when the receiver holds bytes that it can read.

    python chain.py --json cpu_chain_peers.json          # needs gantry, dora-rs, dora-rs-cli, eclipse-zenoh, pyarrow, numpy

Systems that are not installed are left out, and said so.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import numpy as np

LINKS = 3
WARM_UP = 30
SIZES = {"800x600": (600, 800), "1920x1080": (1080, 1920)}
now = time.monotonic_ns


class Seen:
    """What one process saw, nanoseconds."""

    def __init__(self) -> None:
        self.hop: list[int] = []
        self.since_camera: list[int] = []

    def take(self, image: np.ndarray) -> int:
        """Notes an image in hand; returns the camera's stamp, or −1 for the image that ends the chain."""
        held = now()
        origin, sent = image[:16].view(np.int64)
        if origin >= 0:
            self.hop.append(held - int(sent))
            self.since_camera.append(held - int(origin))
        return int(origin)

    def write(self, out: str, link: int) -> None:
        pathlib.Path(out, f"link{link}.json").write_text(json.dumps({"hop": self.hop, "since_camera": self.since_camera}))


def stamp(image: np.ndarray, origin: int | None) -> None:
    sent = now()
    image[:16].view(np.int64)[:] = (sent if origin is None else origin, sent)


def paced(n: int, rate: float):
    """Counts to n at this rate."""
    due = time.monotonic()
    for i in range(n):
        time.sleep(max(0.0, due - time.monotonic()))
        due = max(due, time.monotonic() - 1 / rate) + 1 / rate
        yield i


# --- Gantry ---------------------------------------------------------------------------------------------------------------


def gantry(role: str, size: tuple[int, int], n: int, rate: float, out: str, domain: str) -> None:
    import gantry as g

    shape, n_bytes = (*size, 4), size[0] * size[1] * 4
    if role == "camera":
        with g.publish("chain/link0", "image", domain=domain, max_bytes=n_bytes) as topic:
            while topic.n_readers == 0:
                time.sleep(0.01)
            time.sleep(1.0)
            for i in paced(WARM_UP + n + 1, rate):
                with topic.loan(shape, np.uint8, format="bgra8") as image:
                    image.fill(i % 251)
                    stamp(image.reshape(-1), -1 if i == WARM_UP + n else None)
            time.sleep(0.5)
        return
    link, seen = int(role), Seen()
    with (
        g.open(f"chain/link{link - 1}", domain, timeout=30) as inlet,
        g.publish(f"chain/link{link}", "image", domain=domain, max_bytes=n_bytes) as outlet,
    ):
        for frame in inlet:
            origin = seen.take(frame.array.reshape(-1))
            with outlet.loan(shape, np.uint8, format="bgra8", answers=frame) as image:
                np.copyto(image, frame.array)
                stamp(image.reshape(-1), origin)
            if origin < 0:
                break
    seen.write(out, link)
    time.sleep(0.5)


def run_gantry(size: tuple[int, int], n: int, rate: float, out: str) -> None:
    domain = f"chain{os.getpid()}"
    roles = [*(str(link) for link in range(LINKS, 0, -1)), "camera"]
    started = [child("gantry", role, size, n, rate, out, domain) for role in roles]
    finish(started)


# --- dora -----------------------------------------------------------------------------------------------------------------


def dora(role: str, size: tuple[int, int], n: int, rate: float, out: str, _: str) -> None:
    from dora import Node

    node, n_bytes = Node(), size[0] * size[1] * 4
    if role == "camera":
        time.sleep(2)
        for i in paced(WARM_UP + n + 1, rate):
            with node.send_output_raw("image", n_bytes) as buffer:
                image = np.asarray(buffer, dtype=np.uint8)
                image.fill(i % 251)
                stamp(image, -1 if i == WARM_UP + n else None)
                del image  # dora sends only when no view is left
        time.sleep(1)
        return
    link, seen = int(role), Seen()
    for event in node:
        if event["type"] == "STOP":
            break
        if event["type"] != "INPUT":
            continue
        image = event["value"].to_numpy(zero_copy_only=True)
        origin = seen.take(image)
        with node.send_output_raw("image", n_bytes) as buffer:
            copy = np.asarray(buffer, dtype=np.uint8)
            np.copyto(copy, image)
            stamp(copy, origin)
            del copy
        del image, event
        if origin < 0:
            break
    seen.write(out, link)
    time.sleep(0.5)


def run_dora(size: tuple[int, int], n: int, rate: float, out: str) -> None:
    node = f"{size[0]} {size[1]} {n} {rate} {out} -"
    lines = ["nodes:"]
    for link in range(LINKS + 1):
        role = "camera" if link == 0 else str(link)
        lines += [f"  - id: link{link}", f"    path: {sys.executable}", f"    args: {pathlib.Path(__file__).resolve()} --part dora {role} {node}", "    outputs: [image]"]
        if link:
            lines += ["    inputs:", "      image:", f"        source: link{link - 1}/image", "        queue_size: 64"]
    flow = pathlib.Path(out, "flow.yml")
    flow.write_text("\n".join(lines) + "\n")
    environment = {**os.environ, "DORA_NODE_SHM_POOL_SIZE": "134217728", "PATH": f"{pathlib.Path(sys.executable).parent}:{os.environ['PATH']}"}
    with open(pathlib.Path(out, "dora.log"), "w") as log:
        subprocess.run(["dora", "run", str(flow)], cwd=out, env=environment, stdout=log, stderr=log, stdin=subprocess.DEVNULL, timeout=180)


# --- zenoh with shared memory -------------------------------------------------------------------------------------------------


def zenoh(role: str, size: tuple[int, int], n: int, rate: float, out: str, port: str) -> None:
    import zenoh as z
    from zenoh.handlers import FifoChannel

    link, n_bytes = 0 if role == "camera" else int(role), size[0] * size[1] * 4

    def session(listen: list[str], connect: list[str]):
        config = z.Config()
        for key, value in {"scouting/multicast/enabled": False, "transport/shared_memory/enabled": True}.items():
            config.insert_json5(key, json.dumps(value))
        config.insert_json5("listen/endpoints", json.dumps(listen))
        config.insert_json5("connect/endpoints", json.dumps(connect))
        return z.open(config)

    def address(of: int) -> str:
        return f"tcp/127.0.0.1:{int(port) + of}"

    s = session([address(link)], [address(link - 1)] if link else [])
    outlet = s.declare_publisher(f"chain/link{link}", congestion_control=z.CongestionControl.BLOCK, express=True)
    provider, policy = z.shm.ShmProvider.default_backend(max(n_bytes * 12, 1 << 20)), z.shm.BlockOn(z.shm.GarbageCollect())

    def send(image: np.ndarray, origin: int | None) -> None:
        stamp(image, origin)
        buffer = provider.alloc(n_bytes, policy)
        buffer[0:n_bytes] = image.tobytes()  # the binding takes bytes only
        outlet.put(buffer)

    if link == 0:
        image = np.zeros(n_bytes, np.uint8)
        time.sleep(3)
        for i in paced(WARM_UP + n + 1, rate):
            image.fill(i % 251)
            send(image, -1 if i == WARM_UP + n else None)
        time.sleep(1)
    else:
        inlet, seen = s.declare_subscriber(f"chain/link{link - 1}", FifoChannel(64)), Seen()
        while True:
            image = np.frombuffer(inlet.recv().payload.to_bytes(), np.uint8)  # readable through a copy only
            origin = seen.take(image)
            send(image.copy(), origin)
            if origin < 0:
                break
        seen.write(out, link)
        time.sleep(1)
    s.close()


def run_zenoh(size: tuple[int, int], n: int, rate: float, out: str) -> None:
    port = str(20000 + os.getpid() % 20000)
    started = []
    for role in ["camera", *(str(link) for link in range(1, LINKS + 1))]:
        started.append(child("zenoh", role, size, n, rate, out, port))
        time.sleep(0.3)
    finish(started)


# --- the run ------------------------------------------------------------------------------------------------------------------

PARTS = {"gantry": gantry, "dora": dora, "zenoh": zenoh}
RUNS = {"gantry": (run_gantry, "gantry"), "dora": (run_dora, "dora"), "zenoh": (run_zenoh, "zenoh")}


def child(system: str, role: str, size: tuple[int, int], n: int, rate: float, out: str, extra: str) -> subprocess.Popen:
    words = [system, role, *map(str, size), str(n), str(rate), out, extra]
    return subprocess.Popen([sys.executable, __file__, "--part", *words], stdin=subprocess.DEVNULL)


def finish(started: list[subprocess.Popen]) -> None:
    for process in started:
        try:
            process.wait(timeout=180)
        except subprocess.TimeoutExpired:
            process.kill()


def installed(module: str) -> bool:
    try:
        __import__(module)
        return True
    except ImportError:
        print(f"{module} is not installed here; left out", file=sys.stderr)
        return False


def machine(load: float) -> dict[str, object]:
    """The machine as the other benches describe it."""
    cpu = next((line.split(":", 1)[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), "unknown")
    words = ["git", "-C", str(pathlib.Path(__file__).parent), "describe", "--always", "--dirty", "--abbrev=10"]
    commit = subprocess.run(words, capture_output=True, text=True).stdout.strip() or "unknown"
    return {
        "cpu": cpu,
        "n_cores": os.cpu_count(),
        "kernel": os.uname().release,
        "load_1min": f"{load:.2f}",
        "commit": commit,
        "command": " ".join(["chain.py", *sys.argv[1:]]),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=300, help="images counted per turn")
    parser.add_argument("--rate", type=float, default=50.0, help="images per second")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--only", default="gantry,dora,zenoh")
    parser.add_argument("--json", default="")
    args = parser.parse_args()
    load = os.getloadavg()[0]
    systems = [name for name in args.only.split(",") if installed(RUNS[name][1])]
    seen: dict[tuple[str, str, int], dict[str, list[int]]] = {}
    for _ in range(args.turns):
        for label, size in SIZES.items():
            for system in systems:
                with tempfile.TemporaryDirectory() as out:
                    RUNS[system][0](size, args.count, args.rate, out)
                    for link in range(1, LINKS + 1):
                        file = pathlib.Path(out, f"link{link}.json")
                        found = json.loads(file.read_text()) if file.exists() else {"hop": [], "since_camera": []}
                        kept = seen.setdefault((label, system, link), {"hop": [], "since_camera": []})
                        for key, list_ in found.items():
                            kept[key] += list_[WARM_UP:]
    rows = []
    for (label, system, link), found in sorted(seen.items()):
        row = {"name": f"{label} {system} {link}", "n": len(found["hop"])}
        for key, list_ in found.items():
            for q in (50, 99):
                row[f"{key}_p{q}_us"] = round(float(np.percentile(list_, q)) / 1e3, 1) if list_ else None
        rows.append(row)
        print(*row.values(), sep="\t")
    if args.json:
        result = {"bench": "chain_peers", "machine": machine(load), "rows": rows}
        pathlib.Path(args.json).write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--part"]:
        system, role, height, width, n, rate, out, extra = sys.argv[2:]
        PARTS[system](role, (int(height), int(width)), int(n), float(rate), out, extra)
    else:
        main()
