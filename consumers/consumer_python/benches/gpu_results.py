"""Results of torch that stay on the GPU, between processes: are the bytes the same, how soon are they there, what do kills leave?

    gpu_results.py [--domain results] [--n 300] [--mib 8] [--kills N]

Needs torch with CUDA, and no simulator. It ends with 1 if a single result differs. Times are from the moment before
`send` to a tensor in the other process, microseconds. Memory of the GPU is nvidia-smi's, before and after the kills.
"""

import argparse
import os
import statistics
import subprocess
import sys
import time

import gantry

TYPES = ["uint8", "int8", "int16", "int32", "int64", "float16", "float32", "float64", "bool"]


def pattern(tick, n, device):
    """The elements of the result of a tick, the same in every process."""
    import torch

    return (torch.arange(n, device=device, dtype=torch.int64) * 7 + tick * 13) % 251


def writer(arguments):
    """Publishes until it is killed or told to end: of every type, from other streams, strided, late, as loans."""
    import torch

    device = torch.device("cuda")
    side, heavy = torch.cuda.Stream(), torch.randn(4096, 4096, device=device)
    n = arguments.mib << 17
    with gantry.publish("bench/results", "tensor", domain=arguments.domain, device="cuda") as topic:
        print("publishing", flush=True)
        tick = arguments.first
        while True:
            tick += 1
            kind = getattr(torch, TYPES[tick % len(TYPES)])
            way = tick % 4
            with torch.cuda.stream(side if way == 1 else torch.cuda.current_stream()):
                if way == 2:
                    # The tensor is ready long after it is sent: 30 products of matrices stand before it.
                    for _ in range(30):
                        heavy = torch.tanh(heavy @ heavy)
                made = pattern(tick, n, device).to(kind).reshape(8, -1)
                if way == 3:
                    with topic.loan(made.shape, kind, tick=tick) as slot:
                        slot.torch().copy_(made)
                elif way == 0:
                    # Every second element of a wider tensor.
                    topic.send(torch.stack([made, made], -1)[..., 0], tick=tick)
                else:
                    topic.send(made, tick=tick)
            del made
            time.sleep(0.002)


def reader(arguments):
    """Reads on the GPU, compares there, and holds the last two results when it is killed."""
    held = []
    with gantry.open("bench/results", domain=arguments.domain, timeout=60, device="cuda") as topic:
        for result in topic:
            held = [*held[-1:], check(result, result.torch())]
            print("read", result.tick, flush=True)


def check(result, tensor):
    """Compares a result with what its tick says, on the GPU."""
    import torch

    wanted = pattern(result.tick, tensor.numel(), tensor.device).to(tensor.dtype).reshape(tensor.shape)
    if not torch.equal(tensor, wanted):
        sys.exit(f"tick {result.tick} of {tensor.dtype} differs in {(tensor != wanted).sum().item()} of {tensor.numel()} elements")
    return tensor


def start(what, arguments, first=0):
    """Starts this program as the other side."""
    command = [sys.executable, os.path.abspath(__file__), "--role", what, "--domain", arguments.domain, "--mib", str(arguments.mib), "--first", str(first)]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    line = child.stdout.readline()
    if not line:
        sys.exit(f"the {what} ended with {child.wait()}")
    return child


def end(child):
    """Kills a process as nobody should."""
    child.kill()
    child.wait()
    child.stdout.close()


def used_mib():
    """GPU memory in use, as the driver says."""
    asked = ["nvidia-smi", "--query-gpu=memory.used", "--format=csv,noheader,nounits"]
    return int(subprocess.run(asked, capture_output=True, text=True, check=True).stdout.split()[0])


def equal(arguments):
    """Every type and every way of sending, on the GPU and in shared memory."""
    import numpy as np
    import torch

    child = start("writer", arguments)
    seen = {"GPU": 0, "shared memory": 0}
    both = 0
    with gantry.open("bench/results", domain=arguments.domain, timeout=60, device="cuda") as gpu, gantry.open("bench/results", domain=arguments.domain) as host:
        assert gpu.fallback is None, gpu.fallback
        kept = {}
        while seen["GPU"] < arguments.n:
            result = gpu.next(timeout=60)
            tensor = check(result, result.torch())
            if seen["GPU"] % 3 == 0:
                check(result, torch.from_dlpack(result))
            seen["GPU"] += 1
            kept = {tick: copy for tick, copy in kept.items() if tick > result.tick - 8}
            while (there := host.poll()) is not None:
                wanted = pattern(there.tick, there.array.size, "cpu").numpy().astype(there.array.dtype).reshape(there.array.shape)
                if not np.array_equal(there.array, wanted):
                    sys.exit(f"tick {there.tick} differs in shared memory")
                seen["shared memory"] += 1
                kept[there.tick] = there.copy()
                del there
            if result.tick in kept:
                both += int(np.array_equal(kept[result.tick], tensor.cpu().numpy()))
            del result, tensor
        print(f"{seen['GPU']} results equal on the GPU, {seen['shared memory']} in shared memory, {both} held against one another; lost {gpu.counts.lost}", flush=True)
    end(child)


def soon(arguments):
    """From before `send` to a tensor in another process, against a copy over the bus."""
    import torch

    n = arguments.mib << 18
    data = torch.randn(n, device="cuda")
    rows = []
    for name, publisher_device, reader_device in (("on the GPU", "cuda", "cuda"), ("over shared memory", None, None)):
        topic = f"bench/{'device' if publisher_device else 'host'}"
        code = (
            "import gantry, sys, time, torch\n"
            "torch.ones(1, device='cuda').sum().item()\n"
            f"with gantry.open({topic!r}, domain={arguments.domain!r}, timeout=60, device={reader_device!r}) as t:\n"
            " print('reading', flush=True)\n"
            f" for _ in range({arguments.n}):\n"
            "  r = t.next(timeout=60)\n"
            + ("  x = r.torch()\n" if reader_device else "  x = torch.from_numpy(r.copy()).to('cuda'); torch.cuda.synchronize()\n")
            + "  done = time.monotonic_ns(); print(r.tick, done, r.header.published_mono_nanos, flush=True); del x, r\n"
        )
        with gantry.publish(topic, "tensor", domain=arguments.domain, device=publisher_device) as out:
            child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
            child.stdout.readline()
            begun = {}
            for tick in range(1, arguments.n + 1):
                data.add_(1)
                torch.cuda.synchronize()
                begun[tick] = time.monotonic_ns()
                out.send(data if publisher_device else data.cpu().numpy(), tick=tick)
                time.sleep(0.005)
            times = [tuple(int(word) for word in line.split()) for line in child.stdout]
            child.wait()
        whole = sorted((done - begun[tick]) / 1e3 for tick, done, _ in times[20:])
        after = sorted((done - sent) / 1e3 for _, done, sent in times[20:])
        rows.append(f"| {name:20} | {statistics.median(whole):8.0f} / {whole[int(0.99 * len(whole)) - 1]:8.0f} | {statistics.median(after):8.0f} |")
    print(f"\ntensors of {arguments.mib} MiB, {arguments.n} of them, µs\n\n| way | send to tensor, p50 / p99 | published to tensor, p50 |\n|---|---|---|\n" + "\n".join(rows), flush=True)


def kills(arguments):
    """Readers and writers that are killed while the other side goes on."""
    children = [start("writer", arguments), start("reader", arguments)]
    time.sleep(1)
    used = [used_mib()]
    for _ in range(arguments.kills):
        end(start("reader", arguments))
    went_on = lines_after(children[1])
    time.sleep(5)
    used.append(used_mib())
    print(f"\n{arguments.kills} readers killed: {used[0]} MiB in use before, {used[1]} MiB after; the other reader went on: {went_on}", flush=True)
    for turn in range(1, arguments.kills // 4 + 1):
        end(children[0])
        children[0] = start("writer", arguments, turn * 1_000_000)
        went_on = lines_after(children[1], turn * 1_000_000)
    time.sleep(5)
    used.append(used_mib())
    print(f"{arguments.kills // 4} writers killed: {used[2]} MiB in use after; the reader went on: {went_on}", flush=True)
    for child in children:
        end(child)
    time.sleep(5)
    print(f"all ended: {used_mib()} MiB in use", flush=True)


def lines_after(child, tick=0):
    """Whether a reader says that it reads, of a tick after this one."""
    for _ in range(1_000_000):
        line = child.stdout.readline()
        if not line:
            return False
        if int(line.split()[1]) > tick:
            return True
    return False


def main():
    """Runs all parts, or one side."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--domain", default="results")
    parser.add_argument("--n", type=int, default=300)
    parser.add_argument("--mib", type=int, default=8)
    parser.add_argument("--kills", type=int, default=0)
    parser.add_argument("--role", choices=["writer", "reader"])
    parser.add_argument("--first", type=int, default=0)
    arguments = parser.parse_args()
    if arguments.role:
        return {"writer": writer, "reader": reader}[arguments.role](arguments)
    before = used_mib()
    equal(arguments)
    soon(arguments)
    if arguments.kills:
        kills(arguments)
    print(f"before anything {before} MiB, at the end {used_mib()} MiB in use, of which this process has its own")
    left = [name for name in os.listdir("/dev/shm") if name.startswith("iox2_")]
    print(f"files of the bus in /dev/shm: {len(left)}")
    return None


if __name__ == "__main__":
    main()
