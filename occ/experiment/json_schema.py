"""The JSON Schema of experiment files, for editors."""

from __future__ import annotations

from typing import Any

from occ.experiment.schema import OWN_KIND, ExperimentFile


def json_schema() -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of experiment files."""
    schema = ExperimentFile.model_json_schema()
    schema["$defs"]["OwnController"] = _own_controller_schema(schema["$defs"]["ServoLaw"]["properties"]["name"])
    schema["properties"]["controller"]["items"]["oneOf"].append({"$ref": "#/$defs/OwnController"})
    # A sweep may supply a whole table, so that only a file without one must have them all.
    tables = [name for name in schema["required"] if name != "controller"]
    schema |= {"required": ["controller"], "anyOf": [{"required": ["sweep"]}, {"required": tables}]}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _own_controller_schema(name: dict[str, Any]) -> dict[str, Any]:
    """A controller of the user's own, whose further keys only its file knows."""
    kind = {"type": "string", "pattern": OWN_KIND, "description": "path/to/file.py:ClassName, beside the experiment"}
    return {
        "type": "object",
        "description": "A controller from a file of your own, loaded only with --allow-code; its fields are the keys.",
        "properties": {"kind": kind, "name": name},
        "required": ["kind", "name"],
    }
