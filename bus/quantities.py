"""Numbers that parameters of kinds are, with the values that they may take."""

from __future__ import annotations

from typing import Annotated

from annotated_types import Interval

Probability = Annotated[float, Interval(ge=0.0, le=1.0)]
