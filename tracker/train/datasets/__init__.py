"""Big data sets in their published layouts, as Imagery whose pictures stay on the disc."""

from tracker.train.datasets.index import DatasetError
from tracker.train.datasets.joined import JoinedImagery
from tracker.train.datasets.sources import Source, credits_of_sets, load_sources

__all__ = ["DatasetError", "JoinedImagery", "Source", "credits_of_sets", "load_sources"]
