"""Other readers of boards with codes. Each needs the complete target; one that is not installed is skipped with the
reason.

The decoder of the PuzzleBoard's authors is in no package index (it is in their repository): calib-targets is used
instead.
"""

from rcdn_lab.peers.coded import aprilgrid, calibtargets, opencv
from rcdn_lab.peers.coded.base import CodedPeer, Labelled, Read

CODED_PEERS = {peer.name: peer for peer in (opencv.OPENCV, aprilgrid.APRILGRID, calibtargets.CALIB_TARGETS)}
"""All known readers, by name."""

__all__ = ["CODED_PEERS", "CodedPeer", "Labelled", "Read"]
