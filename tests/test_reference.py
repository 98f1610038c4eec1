"""docs/reference/api.md is whole: every public class and function stands in it, a class with all of its methods."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import re
from pathlib import Path

import public_calls

PAGE = Path(__file__).resolve().parent.parent / "docs" / "reference" / "api.md"
DIRECTIVE = re.compile(r"^\.\. auto(\w+):: ([\w.]+)\n((?: {3}:.*\n)*)", re.MULTILINE)


def described() -> dict[int, str]:
    """Give what the page describes by its id, with the options of its directive."""
    found: dict[int, str] = {}
    for kind, name, options in DIRECTIVE.findall(PAGE.read_text(encoding="utf-8")):
        if kind == "module":
            module = importlib.import_module(name)
            found |= {id(getattr(module, public)): options for public in module.__all__}
        else:
            place, _, attribute = (name if name.startswith("rsflow.") else f"rsflow.{name}").rpartition(".")
            found[id(getattr(importlib.import_module(place), attribute))] = options
    return found


def test_every_public_class_and_function_is_in_the_reference():
    public, page = public_calls.public(), described()
    classes = {name for name, value in public.items() if isinstance(value, type)}
    tops = {name for name in public if name.rpartition(".")[0] not in classes}
    assert len(tops) > 100
    assert sorted(name for name in tops if id(public[name]) not in page) == []


def test_a_class_is_described_with_all_of_its_methods():
    public, page = public_calls.public(), described()
    methods = {name.rpartition(".")[0] for name in public if isinstance(public.get(name.rpartition(".")[0]), type)}
    assert len(methods) > 20
    assert sorted(name for name in methods if not re.search(r":members:\s*$", page[id(public[name])], re.M)) == []


# OpenCV's own arguments, of which some are not looked at; and what matplotlib's axes are told by, an overload.
OTHERS_TYPES = {"rsflow.FlowField.plot", *(name for name in public_calls.public() if ".opencv." in name)}


def test_what_is_public_has_a_type():
    """No argument, attribute or result is of any type at all."""
    untyped = []
    for name, value in public_calls.public().items():
        if dataclasses.is_dataclass(value):
            untyped += [f"{name}.{item.name}" for item in dataclasses.fields(value) if item.type == "Any"]
        if name in OTHERS_TYPES or isinstance(value, property) or name == "rsflow.Frames":
            continue
        try:
            signature = inspect.signature(value)
        except ValueError:
            continue
        named = [item for item in signature.parameters.values() if item.kind is not item.VAR_KEYWORD]
        untyped += [f"{name}({item.name})" for item in named if item.annotation == "Any"]
        if signature.return_annotation == "Any":
            untyped.append(f"{name} ->")
    assert untyped == []
