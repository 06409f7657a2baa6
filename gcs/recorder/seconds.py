"""Times as a record can hold them; a line with another one is damaged."""

from __future__ import annotations

from typing import Annotated

import msgspec

# 126 years: of any clock that a flight goes by. Beyond, sums of two and times 1e9 no longer fit where they must.
Seconds = Annotated[float, msgspec.Meta(ge=-4e9, le=4e9)]
