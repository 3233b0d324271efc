"""Batch processing: expanding the inputs, worker processes, the cache of detections, and atomic writing of outputs."""
