"""What the process that forks a run's nodes has loaded before it forks: importing this module loads it all.

A child finds it there and shares its memory: the collector of garbage, which writes to what it looks at,
leaves it alone.
"""

import gc

gc.disable()  # nearly all that is made here stays

from importlib import import_module  # noqa: E402

from orchestrator.registry import own_modules  # noqa: E402

for module in ("numpy.random", "orchestrator.backends.child", *own_modules()):
    import_module(module)

gc.freeze()
gc.enable()
