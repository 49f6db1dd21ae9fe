"""Makes what users install: a wheel with every program and the Python module, a tarball and a .deb.

`./gantry package` builds the programs and runs this. The same commit gives the same bytes: sources'
paths are taken out by the build, times are those of the commit, files are sorted.
"""

import argparse
import gzip
import hashlib
import io
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import uuid
from pathlib import Path

from wheel.wheelfile import WheelFile

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[2]
PYTHON = ROOT / "consumers" / "consumer_python"
# Headers, pkg-config and CMake files as they lie in a prefix, and the library's name there.
C = ROOT / "consumers" / "consumer_c"
C_LIBRARY = "libgantry.so.1"
# The file with every program in it, by cargo's name (launch/launch_all). Called so, it names them; in a
# package it is `gantry`, and the other programs are links to it.
ALL = "launch_all"
MAIN = "gantry"
# A wheel can hold no links. What stands there for a program keeps the process and its name; -p: nothing
# of the user's shell is read.
SCRIPT = """#!/bin/bash -p
# This program is in the file gantry beside it, which looks at the name by which it is called.
own=$0
if [[ $own != /* || -L $own ]]; then own=$(readlink -f -- "$own"); fi
exec -a "$own" "${own%/*}/gantry" "$@"
"""
# Programs that write into a terminal or read from users: these have completions and a man page.
SHELLS = {
    "bash": ("bash-completion/completions", "{}"),
    "zsh": ("zsh/vendor-completions", "_{}"),
    "fish": ("fish/vendor_completions.d", "{}.fish"),
}
# Libraries that a wheel of the tag manylinux may expect of every system, and the Debian package of each.
SYSTEM = {
    "libc.so.6": None,
    "libm.so.6": None,
    "libpthread.so.0": None,
    "libdl.so.2": None,
    "librt.so.1": None,
    "ld-linux-x86-64.so.2": None,
    "ld-linux-aarch64.so.1": None,
    "libgcc_s.so.1": "libgcc-s1",
    "libstdc++.so.6": "libstdc++6",
}
# Newest versions of the C++ library's symbols that the tag manylinux_2_35 and later ones allow.
NEWEST_CXX = {"GLIBCXX": (3, 4, 30), "CXXABI": (1, 3, 13), "GCC": (12, 0, 0)}
# What an ELF file calls the processor, and what Python and Debian call it.
MACHINES = {62: ("x86_64", "amd64"), 183: ("aarch64", "arm64")}
# Either of them, as the user likes.
LICENSES = ["LICENSE-MIT", "LICENSE-APACHE"]
SUMMARY = "Headless driving simulator whose sensors write straight into shared memory"


# For programs of another processor than this one's: GNU's name of the system they are for, whose tools
# read them, and what runs them here to print their man pages, with the Debian packages of both.
FOREIGN = {"aarch64": ("aarch64-linux-gnu", "binutils-aarch64-linux-gnu", "qemu-aarch64-static", "qemu-user-static")}


class Failed(Exception):
    """A sentence for whoever packages."""


def output(*words, **more):
    """What a program prints."""
    done = subprocess.run(words, capture_output=True, text=True, check=False, **more)
    if done.returncode:
        raise Failed(f"{' '.join(map(str, words))} ended with code {done.returncode}: {done.stderr.strip()}")
    return done.stdout


def version():
    found = re.search(r'^version = "([^"]+)"', (ROOT / "Cargo.toml").read_text(), re.M)
    return found[1]


def moment():
    """The time that all files carry, seconds since 1970: that of the commit; in a tree without git's
    history, that of Cargo.lock."""
    if given := os.environ.get("SOURCE_DATE_EPOCH"):
        return int(given)
    try:
        return int(output("git", "-C", str(ROOT), "log", "-1", "--format=%ct"))
    except (Failed, FileNotFoundError):
        return int((ROOT / "Cargo.lock").stat().st_mtime)


def built(folder):
    """The files of `folder` that are packed: all programs, the Python module, and the library for C."""
    files = [folder / ALL, folder / "libconsumer_python.so", folder / "libgantry.so"]
    if missing := [file.name for file in files if not file.is_file()]:
        raise Failed(f"{folder} lacks {', '.join(missing)}; build with `cargo build --release --workspace` first")
    return files


def foreign(file):
    """What there is for the processor of `file` in FOREIGN; None if it is this machine's own."""
    processor, _ = machine(file)
    if processor == platform.machine():
        return None
    if processor not in FOREIGN:
        raise Failed(f"{file} is for {processor}; on {platform.machine()} packages are made for it and for {', '.join(FOREIGN)}")
    return FOREIGN[processor]


def tool(name, file):
    """The program of GNU's binutils that reads `file`."""
    found = foreign(file)
    if found is None:
        return name
    system, package, _, _ = found
    if shutil.which(f"{system}-{name}") is None:
        raise Failed(f"{file} is for another processor, and {system}-{name} is missing: apt-get install {package}")
    return f"{system}-{name}"


def runner(file):
    """The words before `file` that run it on this machine."""
    found = foreign(file)
    if found is None:
        return []
    system, _, emulator, package = found
    if shutil.which(emulator) is None:
        raise Failed(f"{file} is for another processor, and {emulator}, which runs it to print its man pages, is missing: apt-get install {package}")
    return [emulator, "-L", f"/usr/{system}"]


def strip(files, into):
    """Copies files without symbols and line tables: a third of the size, no build paths."""
    into.mkdir(parents=True)
    for file in files:
        shutil.copyfile(file, into / file.name)
        (into / file.name).chmod(0o755)
    output(tool("strip", files[0]), "--strip-all", *(str(into / file.name) for file in files))
    return [into / file.name for file in files]


def links(everything, names, into):
    """The programs as they lie in the folder `bin` of a prefix: one file, and links to it."""
    into.mkdir(parents=True)
    shutil.copy2(everything, into / MAIN)
    for name in names:
        if name != MAIN:
            (into / name).symlink_to(MAIN)


def machine(file):
    """The processor that a program is for, as Python and as Debian call it."""
    with file.open("rb") as elf:
        number = int.from_bytes(elf.read(20)[18:20], "little")
    if number not in MACHINES:
        raise Failed(f"{file} is for a processor with the ELF number {number}; packages are made for {list(MACHINES)}")
    return MACHINES[number]


def needed(files):
    """The shared libraries that any of these is linked to."""
    text = output(tool("objdump", files[0]), "-p", *map(str, files))
    found = sorted(set(re.findall(r"NEEDED +(\S+)", text)))
    if foreign := [name for name in found if name not in SYSTEM]:
        raise Failed(f"the programs need {', '.join(foreign)}, which not every system has")
    return found


def glibc(files):
    """The newest GNU C library that any of these needs, as (2, 35), and at least that: the number in
    the wheel's tag, whose limits for the C++ library are checked too."""
    text = output(tool("objdump", files[0]), "-T", *map(str, files))
    versions = {tuple(map(int, match.split("."))) for match in re.findall(r"GLIBC_(\d+\.\d+)", text)}
    if not versions:
        raise Failed("objdump names no version of the C library; are these programs linked dynamically?")
    for name, newest in NEWEST_CXX.items():
        for match in re.findall(rf"\b{name}_(\d+(?:\.\d+)*)", text):
            if tuple(map(int, match.split("."))) > newest:
                raise Failed(f"the programs need {name}_{match}, newer than {name}_{'.'.join(map(str, newest))} of the tag manylinux")
    return max(max(versions), (2, 35))


def pages(programs, share):
    """Completions and man pages, as the programs print them."""
    quiet = {**os.environ, "NO_COLOR": "1"}
    for program in programs:
        with tempfile.TemporaryDirectory() as folder:
            output(*runner(program), program, "man", "--into", folder, env=quiet)
            for page in sorted(Path(folder).iterdir()):
                write(share / "man" / "man1" / f"{page.name}.gz", gzip.compress(page.read_bytes(), mtime=0))
        for shell, (folder, name) in SHELLS.items():
            script = output(*runner(program), program, "completions", shell, env=quiet)
            write(share / folder / name.format(program.name), script.encode())


def write(path, data):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def sbom(when):
    """What the programs are made of: every crate with its version, licence and checksum, as CycloneDX and
    as SPDX, by cargo-sbom. None where that is not installed."""
    tool = shutil.which("cargo-sbom")
    if tool is None:
        return {}
    label = f"gantry-sim-{version()}"
    made = {}
    for ending, form in (("cdx.json", "cyclone_dx_json_1_6"), ("spdx.json", "spdx_json_2_3")):
        text = output(tool, "sbom", "--output-format", form, "--project-directory", str(ROOT))
        made[f"{label}.{ending}"] = stable(json.loads(text), label, when)
    return made


def stable(document, label, when):
    """A document without what differs from call to call: its own number, the time, the order, this
    machine's paths."""
    moment_text = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(when))
    if "serialNumber" in document:
        document["serialNumber"] = f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, f'{label}/{when}')}"
    if "documentNamespace" in document:
        document["documentNamespace"] = f"https://spdx.org/spdxdocs/{uuid.uuid5(uuid.NAMESPACE_URL, f'{label}/{when}')}"
    document.get("metadata", {})["timestamp"] = moment_text
    if "creationInfo" in document:
        document["creationInfo"]["created"] = moment_text
        document.pop("metadata", None)
    for key in ("components", "dependencies", "packages", "relationships", "files"):
        if isinstance(document.get(key), list):
            document[key].sort(key=lambda item: json.dumps(item, sort_keys=True))
    text = json.dumps(document, indent=1, sort_keys=True)
    return text.replace(str(ROOT), "gantry").encode() + b"\n"


def c_files(library, into):
    """`include` and `lib` for programs in C and C++, as below a prefix of a file system."""
    for file in sorted([*(C / "include").rglob("*.h*"), *(C / "lib").rglob("*.pc"), *(C / "lib").rglob("*.cmake")]):
        write(into / file.relative_to(C), file.read_bytes())
    shutil.copyfile(library, into / "lib" / C_LIBRARY)


def tree(everything, library, names, into, name, boms):
    """`bin`, `include`, `lib` and `share` as below a prefix of a file system."""
    links(everything, names, into / "bin")
    c_files(library, into)
    (into / "lib" / "libgantry.so").symlink_to(C_LIBRARY)
    pages([into / "bin" / program for program in names], into / "share")
    launch = into / "share" / "gantry" / "launch"
    for file in sorted((ROOT / "launch").glob("*.toml")) + [ROOT / "launch" / "launch.schema.json"]:
        write(launch / file.name, file.read_bytes())
    for file in sorted((ROOT / "examples").rglob("*")):
        if file.is_file() and "__pycache__" not in file.parts and "target" not in file.parts:
            write(into / "share" / "gantry" / "examples" / file.relative_to(ROOT / "examples"), file.read_bytes())
    for file, text in boms.items():
        write(into / "share" / "doc" / name / file, text)
    for file in ["README.md", *LICENSES]:
        write(into / "share" / "doc" / name / file, (ROOT / file).read_bytes())
    write(into / "share" / "doc" / name / "CHANGELOG.md", (ROOT / "CHANGELOG.md").read_bytes())


def tarball(folder, out, prefix, when):
    """A compressed archive of `folder`: sorted, of nobody, at one time."""

    def plain(entry):
        entry.uid = entry.gid = 0
        entry.uname = entry.gname = "root"
        entry.mtime = when
        entry.mode = 0o755 if entry.isdir() or entry.mode & 0o100 else 0o644
        return entry

    data = io.BytesIO()
    with tarfile.open(fileobj=data, mode="w", format=tarfile.PAX_FORMAT) as archive:
        for path in sorted(folder.rglob("*")):
            archive.add(path, f"{prefix}/{path.relative_to(folder)}", recursive=False, filter=plain)
    out.write_bytes(gzip.compress(data.getvalue(), mtime=0))
    return out


def deb(folder, out, name, libc, libraries, architecture, when):
    """A Debian package of `folder` below /usr."""
    root = folder.parent / "deb"
    shutil.copytree(folder, root / "usr", symlinks=True)
    size = sum(path.stat().st_size for path in root.rglob("*") if path.is_file() and not path.is_symlink()) // 1024
    packages = [SYSTEM[library] for library in libraries if SYSTEM[library]]
    depends = ", ".join([f"libc6 (>= {libc[0]}.{libc[1]})", *packages, "libvulkan1"])
    control = f"""Package: {name}
Version: {version()}
Architecture: {architecture}
Maintainer: Gantry developers <gantry@example.invalid>
Installed-Size: {size}
Depends: {depends}
Recommends: mesa-vulkan-drivers | nvidia-driver
Section: science
Priority: optional
Description: {SUMMARY}
 The daemon simd, the launcher gantry and the programs that view, record, replay, export,
 drive, benchmark and serve unmodified CARLA clients. The live viewer comes with the Python
 package rerun-sdk.
"""
    write(root / "DEBIAN" / "control", control.encode())
    # The loader then knows the library.
    write(root / "DEBIAN" / "triggers", b"activate-noawait ldconfig\n")
    for path in [root, *sorted(root.rglob("*"))]:
        if not path.is_symlink():
            path.chmod(0o755 if path.is_dir() or path.parent.name == "bin" else 0o644)
        os.utime(path, (when, when), follow_symlinks=False)
    output("dpkg-deb", "--root-owner-group", "-Zxz", "--build", str(root), str(out), env={**os.environ, "SOURCE_DATE_EPOCH": str(when)})
    return out


def metadata():
    """What the wheel says of itself, from pyproject.toml."""
    project = tomllib.loads((PYTHON / "pyproject.toml").read_text())["project"]
    # What the programs need comes with them; the rest is for who asks for it.
    extras = {name: needs for name, needs in project["optional-dependencies"].items() if name != "programs"}
    lines = [
        "Metadata-Version: 2.1",
        f"Name: {project['name']}",
        f"Version: {version()}",
        f"Summary: {SUMMARY}",
        f"License: {project['license']['text']}",
        *(f"License-File: {file}" for file in LICENSES),
        f"Requires-Python: {project['requires-python']}",
        *(f"Classifier: {classifier}" for classifier in project["classifiers"]),
        *(f"Requires-Dist: {need}" for need in project["dependencies"] + project["optional-dependencies"]["programs"]),
        *(f"Provides-Extra: {name}" for name in extras),
        *(f'Requires-Dist: {need}; extra == "{name}"' for name, needs in extras.items() for need in needs),
        "Description-Content-Type: text/markdown",
    ]
    return "\n".join(lines) + "\n\n" + (PYTHON / "README.md").read_text()


def wheel(everything, names, module, library, out, work, libc, processor, boms, when):
    """The Python package, its native module, the programs as its scripts, and the files for C, which pip puts
    into `include` and `lib` of the environment."""
    root = work / "wheel"
    shutil.copytree(PYTHON / "python" / "gantry", root / "gantry", ignore=shutil.ignore_patterns("__pycache__", "_native*.so"))
    native = root / "gantry" / "_native.abi3.so"
    shutil.copyfile(module, native)
    name = f"gantry_sim-{version()}"
    scripts = root / f"{name}.data" / "scripts"
    scripts.mkdir(parents=True)
    shutil.copyfile(everything, scripts / MAIN)
    for program in names:
        if program != MAIN:
            write(scripts / program, SCRIPT.encode())
    c_files(library, root / f"{name}.data" / "data")
    tag = f"cp310-abi3-manylinux_{libc[0]}_{libc[1]}_{processor}"
    about = root / f"{name}.dist-info"
    write(about / "METADATA", metadata().encode())
    write(about / "WHEEL", f"Wheel-Version: 1.0\nGenerator: gantry {version()}\nRoot-Is-Purelib: false\nTag: {tag}\n".encode())
    for file in LICENSES:
        write(about / file, (ROOT / file).read_bytes())
    for file, text in boms.items():
        write(about / "sboms" / file, text)
    for path in root.rglob("*"):
        path.chmod(0o755 if path.is_dir() or path.parent == scripts else 0o644)
    os.environ["SOURCE_DATE_EPOCH"] = str(when)
    file = out / f"{name}-{tag}.whl"
    file.unlink(missing_ok=True)
    with WheelFile(file, "w") as archive:
        archive.write_files(root)
    return file


def main():
    parser = argparse.ArgumentParser(prog="./gantry package", description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the packages [default: target/packages]")
    parser.add_argument("--binaries", type=Path, required=True, metavar="DIR", help="pack the programs of this folder as they are [default: those of a build without paths of this machine]")
    # ./gantry takes it: by then the programs are built.
    parser.add_argument("--target", metavar="TRIPLE", help="build for this processor: aarch64-unknown-linux-gnu or x86_64-unknown-linux-gnu [default: this machine's]")
    parser.add_argument("--only", choices=["wheel", "tar", "deb"], action="append", help="make this one alone; may be given more than once")
    args = parser.parse_args()
    wanted = args.only or ["wheel", "tar", "deb"]
    when = moment()
    args.out.mkdir(parents=True, exist_ok=True)
    work = args.out / ".work"
    shutil.rmtree(work, ignore_errors=True)
    everything, module, library = strip(built(args.binaries), work / "stripped")
    names = output(*runner(everything), str(everything)).split()
    libc = glibc([everything, module, library])
    libraries = needed([everything, module, library])
    processor, architecture = machine(module)
    boms = sbom(when)
    name = "gantry-sim"
    made = []
    try:
        if "tar" in wanted or "deb" in wanted:
            tree(everything, library, names, work / "tree", name, boms)
        if "tar" in wanted:
            label = f"{name}-{version()}-{processor}-linux"
            made.append(tarball(work / "tree", args.out / f"{label}.tar.gz", label, when))
        if "deb" in wanted:
            made.append(deb(work / "tree", args.out / f"{name}_{version()}_{architecture}.deb", name, libc, libraries, architecture, when))
        if "wheel" in wanted:
            made.append(wheel(everything, names, module, library, args.out, work, libc, processor, boms, when))
    finally:
        shutil.rmtree(work, ignore_errors=True)
    for file in made:
        data = file.read_bytes()
        print(f"{hashlib.sha256(data).hexdigest()}  {file}  {len(data) / 1e6:.1f} MB")


if __name__ == "__main__":
    try:
        main()
    except Failed as error:
        sys.exit(f"error: {error}")
