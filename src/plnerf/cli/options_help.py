"""The texts that --help shows for settings, read from the strings below the fields of their classes."""

import ast
import inspect
import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from itertools import pairwise
from types import MappingProxyType, ModuleType


def describe_settings() -> None:
    """Give each field of plnerf's loaded dataclasses its text, as `metadata["help"]`.

    The parser of options would find the texts too.  It reads a class's module anew for every class, which
    took a third of the time of a help with hundreds of options; here every module is read once.  A field
    without a text, for which the parser would search its module, has that of its type.
    """
    for name, module in list(sys.modules.items()):
        if not name.startswith("plnerf."):
            continue
        classes = {cls.__name__: cls for cls in vars(module).values() if _is_dataclass_of(module, cls)}
        if not classes:
            continue
        for node in ast.parse(inspect.getsource(module)).body:
            if isinstance(node, ast.ClassDef) and node.name in classes:
                texts = dict(_texts(node))
                for field in fields(classes[node.name]):
                    if text := texts.get(field.name) or text_of_type(field.type):
                        field.metadata = MappingProxyType({"help": text, **field.metadata})


def _is_dataclass_of(module: ModuleType, value: object) -> bool:
    return isinstance(value, type) and is_dataclass(value) and value.__module__ == module.__name__


def text_of_type(type_: object) -> str:
    """What a class of settings says of itself, a line for each paragraph; nothing of other types."""
    if not (isinstance(type_, type) and is_dataclass(type_)):
        return ""
    paragraphs = inspect.cleandoc(type_.__doc__ or "").split("\n\n")
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs)


def _texts(of_class: ast.ClassDef) -> Iterator[tuple[str, str]]:
    """The names of the class's fields that have a string below them, each with its string as one line."""
    for field, text in pairwise(of_class.body):
        match field, text:
            case (
                ast.AnnAssign(target=ast.Name(id=name)),
                ast.Expr(value=ast.Constant(value=str(words))),
            ):
                yield name, " ".join(words.split())
