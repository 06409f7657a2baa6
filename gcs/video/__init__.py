"""Video from files, image folders, streams and cameras behind one small protocol."""

from gcs.video.frame import Frame, VideoSource
from gcs.video.open import open_source

__all__ = ["Frame", "VideoSource", "open_source"]
