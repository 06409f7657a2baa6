"""The station's pictures as H.264, for other programs: RTSP, RTP and WebRTC. Needs PyAV (extra `video`)."""

from gcs.video_out.out import VideoOut

__all__ = ["VideoOut"]
