"""Prints the reference page of the Python package from its sources: signatures and docstrings of what can be imported.

    book_python_api.py FOLDER_OF_THE_PACKAGE
"""

import ast
import inspect
import pathlib
import re
import sys

HEAD = """# Python API

Made from the docstrings of the package `gantry`; a test holds both together. `consumers/consumer_python/README.md` is the way in, with examples.
"""
MODULES = [("gantry", "."), ("gantry.bench", "bench"), ("gantry.envs", "envs"), ("gantry.testing", "testing"), ("gantry.torch", "torch")]


def definitions(folder):
    """Functions, classes and constants of the files of a folder by name, each with its file's lines."""
    found = {}
    for file in sorted(folder.glob("*.py")):
        lines = file.read_text().splitlines()
        for node in ast.parse("\n".join(lines)).body:
            if any(isinstance(by, ast.Name) and by.id == "overload" for by in getattr(node, "decorator_list", [])):
                continue
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
                found.setdefault(node.name, (node, lines))
            elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                found.setdefault(node.targets[0].id, (node, lines))
            elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                found.setdefault(node.target.id, (node, lines))
    return found


def exported(init):
    """The names of `__all__`."""
    for node in ast.parse(init.read_text()).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__":
            return [item.value for item in node.value.elts]
    return []


def module_doc(init):
    return ast.get_docstring(ast.parse(init.read_text())) or ""


def comment(node, lines):
    """The `#:` comment above a line."""
    said, at = [], node.lineno - 2
    while at >= 0 and lines[at].strip().startswith("#:"):
        said.insert(0, lines[at].strip()[2:].strip())
        at -= 1
    return " ".join(said)


def prose(text):
    """A docstring as Markdown: doctest examples become code."""
    out, code = [], False
    for line in inspect.cleandoc(text).splitlines():
        is_code = line.startswith((">>>", "...")) or (code and line.strip() != "")
        if is_code and not code:
            out += ([""] if out and out[-1] else []) + ["```python"]
        if code and not is_code:
            out.append("```")
        code = is_code
        out.append(line)
    if code:
        out.append("```")
    return "\n".join(out)


def signature(node, name):
    words = ast.unparse(node.args)
    returned = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    # The receiver is not what a caller writes.
    words = re.sub(r"^(self|cls)(, |$)", "", words)
    return f"{name}({words}){returned}"


def decorators(node):
    return [ast.unparse(it) for it in node.decorator_list]


def show_function(name, node):
    print(f"\n### {name}\n\n```python\n{signature(node, name)}\n```\n")
    print(prose(ast.get_docstring(node) or ""))


def show_class(name, node, lines):
    bases = [ast.unparse(base) for base in node.bases]
    print(f"\n### {name}\n")
    if bases:
        print(f"```python\nclass {name}({', '.join(bases)})\n```\n")
    print(prose(ast.get_docstring(node) or ""))
    attributes, methods = [], []
    for item in node.body:
        if isinstance(item, ast.AnnAssign) and not item.target.id.startswith("_"):
            attributes.append((item.target.id, ast.unparse(item.annotation), comment(item, lines)))
        elif isinstance(item, (ast.FunctionDef, ast.AsyncFunctionDef)):
            if item.name == "__init__":
                for line in ast.walk(item):
                    if isinstance(line, ast.AnnAssign) and isinstance(line.target, ast.Attribute) and (said := comment(line, lines)):
                        attributes.append((line.target.attr, ast.unparse(line.annotation), said))
            elif item.name.startswith("_") or "overload" in decorators(item):
                continue
            elif "property" in decorators(item):
                returned = ast.unparse(item.returns) if item.returns else ""
                attributes.append((item.name, returned, ast.get_docstring(item) or ""))
            else:
                methods.append(item)
    if attributes:
        print("\n| Attribute | Type | Meaning |\n|---|---|---|")
        for attribute, kind, said in attributes:
            said = " ".join(said.split()).replace("|", "\\|")
            kind = kind.replace("|", "\\|")
            print(f"| `{attribute}` | `{kind}` | {said} |" if kind else f"| `{attribute}` | | {said} |")
    for method in methods:
        print(f"\n```python\n{signature(method, f'{name}.{method.name}')}\n```\n")
        print(prose(ast.get_docstring(method) or ""))


def main():
    package = pathlib.Path(sys.argv[1])
    print(HEAD, end="")
    for module, folder in MODULES:
        init = package / folder / "__init__.py"
        found = definitions(package / folder)
        print(f"\n## {module}\n\n{prose(module_doc(init))}")
        constants = []
        for name in sorted(exported(init), key=str.lower):
            node, lines = found.get(name, (None, None))
            if isinstance(node, ast.ClassDef):
                show_class(name, node, lines)
            elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                show_function(name, node)
            else:
                value = ast.unparse(node.value) if node is not None and node.value is not None else ""
                said = comment(node, lines) if node is not None else ""
                constants.append((name, said or (f"`{value}`" if 0 < len(value) < 100 else "")))
        if constants:
            print("\n### Constants\n\n| Name | Meaning |\n|---|---|")
            for name, said in constants:
                print(f"| `{name}` | {said.replace('|', chr(92) + '|')} |" if said else f"| `{name}` | |")


if __name__ == "__main__":
    main()
