"""Validates documents with a JSON schema: an implementation of JSON Schema that is not ours.

Reads lines {"name", "document", "valid"} from the second file and prints each on which the schema in the first one disagrees.
"""

import json
import pathlib
import sys

import jsonschema


def main(schema_file: str, documents_file: str) -> None:
    schema = json.loads(pathlib.Path(schema_file).read_text())
    kind = jsonschema.Draft202012Validator
    kind.check_schema(schema)
    validator = kind(schema)
    lines = pathlib.Path(documents_file).read_text().splitlines()
    for line in lines:
        case = json.loads(line)
        errors = [f"{error.json_path}: {error.message}" for error in validator.iter_errors(case["document"])]
        if bool(errors) == case["valid"]:
            print(f"DISAGREES: {case['name']} is {'valid' if case['valid'] else 'wrong'}, but the schema says {errors or 'it is valid'}")
    print(f"validated {len(lines)} documents")


main(*sys.argv[1:])
