"""The LAPACK routines that filters call, without the rest of `scipy.linalg`.

All of them come from one extension module. Importing the package around it loads a hundred others, numpy's
test tools and compiler among them: that takes longer than importing everything else that a node needs, and
every process of a run would hold it.
"""

from __future__ import annotations

import importlib
import importlib.util
from importlib.machinery import PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any

_PUBLIC = "scipy.linalg.lapack"
_EXTENSION = "scipy.linalg._flapack"
_NAMES = ("dpotrf", "dsyev", "dtrtrs")


def _extension() -> ModuleType | None:
    """Load the extension module alone; None where this version of scipy has none of that name."""
    package = importlib.util.find_spec("scipy")
    folders = [] if package is None else package.submodule_search_locations or []
    spec = PathFinder.find_spec(_EXTENSION, [str(Path(folder, "linalg")) for folder in folders])
    if spec is None or spec.loader is None:
        return None
    try:
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    except ImportError:
        return None
    return module if all(hasattr(module, name) for name in _NAMES) else None


_routines: Any = _extension() or importlib.import_module(_PUBLIC)

dpotrf = _routines.dpotrf
dsyev = _routines.dsyev
dtrtrs = _routines.dtrtrs
