"""Prints the page of every key of a launch file from the schema, which is made from the types that read it.

    book_launch_keys.py SCHEMA
"""

import json
import pathlib
import sys

HEAD = """# Every key of a launch file

Made from `launch/launch.schema.json`, which comes from the types that read launch files; a test holds all three together.
[Launch files](launch-files.md) explains how keys work together, [Sensors](sensors.md) what a sensor does with its own.
Units are the ends of keys: `_px` pixels, `_m` metres, `_s` and `_secs` seconds, `_hz` per second, `_deg` degrees, `_rad` radians, `_mps` metres per second, `_mps2` metres per second squared, `_kelvin`; `_ratio` is 0 to 1.
Times of processes are texts with a unit: `"500ms"`, `"2s"`, `"5m"`.
"""


def number(value):
    """A bound as people write it."""
    return str(int(value)) if float(value).is_integer() else str(value)


def form(of):
    """What may be written there."""
    if "enum" in of:
        return ", ".join(f"`{json.dumps(value)}`" for value in of["enum"])
    if "const" in of:
        return f"`{json.dumps(of['const'])}`"
    if "anyOf" in of:
        return " or ".join(form(one) for one in of["anyOf"])
    bounds = ""
    if "minimum" in of and "maximum" in of:
        bounds = f", {number(of['minimum'])} to {number(of['maximum'])}"
    elif "minimum" in of:
        bounds = f", from {number(of['minimum'])}"
    elif "maximum" in of:
        bounds = f", at most {number(of['maximum'])}"
    kind = of.get("type", "value")
    if kind == "array":
        least, most = of.get("minItems", 0), of.get("maxItems")
        n = f" of {least}" if least and least == most else f" of {least} or more" if least else ""
        return f"list{n}: {form(of['items'])}"
    if kind == "string":
        return "time" if "ms|s|m" in of.get("pattern", "") else "text"
    return {"object": "table", "boolean": "`true`, `false`"}.get(kind, kind) + bounds


def rows(key, of):
    """Key, form, default, meaning; of a table those of its keys."""
    if "properties" in of:
        return [row for name, inside in of["properties"].items() for row in rows(f"{key}.{name}", inside)]
    default = f"`{json.dumps(of['default'], ensure_ascii=False)}`" if "default" in of else ""
    return [(f"`{key}`", form(of), default, " ".join(of.get("description", "").split()))]


def show(table):
    print("| Key | May be | Default | Meaning |\n|---|---|---|---|")
    for row in table:
        cells = [cell.replace("|", "\\|") for cell in row]
        print("|" + "|".join(f" {cell} " if cell else " " for cell in cells) + "|")


def tables(name, of):
    """Headings and schemas that a key of the file stands for, such as one for each kind of sensor."""
    if "patternProperties" not in of:
        return [(f"`[{name}]`", of)]
    (inside,) = of["patternProperties"].values()
    name = f'{name}."NAME"' if name == "topic" else f"{name}.NAME"
    if "anyOf" not in inside:
        return [(f"`[{name}]`", inside)]
    kinds = [one for one in inside["anyOf"] if "const" in one.get("properties", {}).get("kind", {})]
    return [(f'`[{name}]`, `kind = "{kind["properties"]["kind"]["const"]}"`', kind) for kind in kinds]


def main():
    properties = json.loads(pathlib.Path(sys.argv[1]).read_text())["properties"]
    print(HEAD + "\n## The file itself\n")
    show(row for key, of in properties.items() if of.get("type") != "object" for row in rows(key, of))
    for name, table in properties.items():
        if table.get("type") != "object":
            continue
        for head, of in tables(name, table):
            print(f"\n## {head}\n")
            if said := of.get("description") or table.get("description"):
                print(" ".join(said.split()) + "\n")
            show(row for key, inside in of["properties"].items() for row in rows(key, inside))


if __name__ == "__main__":
    main()
