"""Graphical output: overlays of detections (`overlay`), boards to print (`target`), and HTML reports
(`calibration`)."""
