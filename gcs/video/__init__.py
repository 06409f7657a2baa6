"""Video from files, image folders, streams and cameras behind one small protocol."""

from gcs.video.frame import Frame, VideoSource
from gcs.video.open import limit_picture_size, open_source

__all__ = ["Frame", "VideoSource", "limit_picture_size", "open_source"]
