"""Time and memory of detection, compared with other detectors on the same pictures: `rcdn bench`.

Nothing is imported here, so that importing `resident` to measure memory takes none.
"""
