"""From the name of a kind to its class: ``module:Class``, or ``path/to/file.py:Class`` for a user's own."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any


class KindError(ValueError):
    """A kind cannot be found or loaded; the message names it and the cure."""


def is_file_reference(reference: str) -> bool:
    """Return whether a reference names a Python file rather than a module."""
    return reference.rpartition(":")[0].endswith(".py")


def content_hash(path: Path) -> str:
    """Return the hash by which a user's file is known in a log, wherever it lies."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def _module_of_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise KindError(f"there is no file {path}")
    name = f"gauntlet_user_{content_hash(path)}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise KindError(f"{path} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        alone = "; a file stands alone: put what it needs into it, or install that as a package"
        cure = alone if isinstance(error, ModuleNotFoundError) else ""
        raise KindError(f"{path} cannot be imported: {type(error).__name__}: {error}{cure}") from error
    return module


def load_class(reference: str) -> type[Any]:
    """Return the class that a reference names; raises `KindError` with the cure."""
    location, _, name = reference.rpartition(":")
    if not location or not name:
        raise KindError(f"'{reference}' is not of the form module:Class or file.py:Class")
    if is_file_reference(reference):
        module = _module_of_file(Path(location))
    else:
        try:
            module = importlib.import_module(location)
        except Exception as error:
            raise KindError(
                f"module '{location}' cannot be imported: {type(error).__name__}: {error}"
            ) from error
    found = getattr(module, name, None)
    if not isinstance(found, type):
        raise KindError(f"'{location}' has no class '{name}'")
    return found
