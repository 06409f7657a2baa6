"""The times of a log's lines, in order."""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import Final

NEARLY_S: Final = 60.0  # an order is written with the time at which it was given


def in_order(times_s: array[float]) -> array[float]:
    """Each at least as late as the one before. The log is in the order of writing, which that of time is nearly.

    A time that is far off from those around it was damaged: it counts as the one before it.
    """
    if all(later - earlier > -NEARLY_S for earlier, later in pairwise(times_s)):
        return array("d", accumulate(times_s, max))
    believed = _longest_rise(times_s)
    ordered, latest_s = array("d"), times_s[min(believed)]
    for place, t_s in enumerate(times_s):
        latest_s = t_s if place in believed else latest_s
        ordered.append(latest_s)
    return ordered


def _longest_rise(values: Sequence[float]) -> set[int]:
    """Places of the most values that never fall."""
    ends, places = list[float](), list[int]()  # of the rises of each length: the least value that ends one, and where
    before = list[int]()
    for place, value in enumerate(values):
        length = bisect_right(ends, value)
        if length == len(ends):
            ends.append(value)
            places.append(place)
        else:
            ends[length], places[length] = value, place
        before.append(places[length - 1] if length else -1)
    found, place = set[int](), places[-1]
    while place >= 0:
        found.add(place)
        place = before[place]
    return found
