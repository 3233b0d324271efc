"""Rigs of real cameras: moments held out, lengths between corners in space, and chains of pairs;
beside OpenCV's solver on the same corners."""
