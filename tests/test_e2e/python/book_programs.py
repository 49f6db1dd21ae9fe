"""Prints the page of all programs from their help texts, one file each, `PROGRAM_SUBCOMMAND.txt`.

    book_programs.py FOLDER_OF_HELP_TEXTS
"""

import pathlib
import re
import sys

#: The order of the page; whatever is not named comes last.
FIRST = ["gantry", "simd", "gantry-render", "gantry-drive", "gantry-view", "gantry-record", "gantry-replay", "gantry-rerun", "gantry-export", "gantry-dataset"]
#: Sections that all help texts have; the page has them once.
SHARED = ("Common options:", "Environment:", "Exit codes:")
#: What of them is about the domain, which not all take: an option to the blank line before the next, and a variable.
DOMAIN = re.compile(r"\n      --domain <NAME>\n.*?(?=\n  -v)|\n  GANTRY_DOMAIN [^\n]*", re.DOTALL)


def divided(text):
    """A help text without the sections that all have, and those by their titles."""
    own, shared, into = [], {}, None
    for line in text.splitlines():
        if line and not line.startswith(" "):
            into = shared.setdefault(line, []) if line in SHARED else own
        (own if into is None else into).append(line)
    return "\n".join(own).rstrip(), {title: "\n".join(lines).rstrip() for title, lines in shared.items()}


def main():
    texts = {tuple(file.stem.split("_")): file.read_text() for file in pathlib.Path(sys.argv[1]).glob("*.txt")}
    common, has_domain = divided(texts["gantry",])[1], {}
    for path, text in texts.items():
        shared = divided(text)[1]
        has_domain[path] = "--domain <NAME>" in shared["Common options:"]
        for title, section in shared.items():
            # What differs among programs would be nowhere on the page.
            expected = {common[title], DOMAIN.sub("", common[title])}
            assert section in expected, f"{' '.join(path)} has other {title}\n{section}"
    order = {name: place for place, name in enumerate(FIRST)}
    print("# Programs\n\nMade from the help texts, which every program prints with `--help`; a test holds both together.")
    print("Man pages and completions say the same: [Install](../start/install.md#completions-and-man-pages).")
    shared = "\n\n".join(common[title] for title in SHARED)
    print(f"\n## What all of them have\n\n```text\n{shared}\n```\n")
    print("`--domain` is there for what meets other programs on the bus; below it is said where it is not.")
    print("`PROGRAM completions bash` (`zsh`, `fish`) prints a completion script, `PROGRAM man` the man page; `PROGRAM man --into DIR` writes one for each subcommand.")
    for path in sorted(texts, key=lambda path: (order.get(path[0], len(order)), path)):
        print(f"\n{'#' * min(len(path) + 1, 4)} {' '.join(path)}\n\n```text\n{divided(texts[path])[0]}\n```")
        if not has_domain[path]:
            print("\nIt has no `--domain`.")


if __name__ == "__main__":
    main()
