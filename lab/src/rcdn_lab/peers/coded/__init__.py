"""Other readers of boards that carry codes. Each must be told what the board is; one that isn't installed says so and is passed over.

The decoder of the PuzzleBoard's authors is in no package index (their repository has it): calib-targets stands for it here.
"""

from rcdn_lab.peers.coded import aprilgrid, calibtargets, opencv
from rcdn_lab.peers.coded.base import CodedPeer, Labelled, Read

CODED_PEERS = {peer.name: peer for peer in (opencv.OPENCV, aprilgrid.APRILGRID, calibtargets.CALIB_TARGETS)}
"""All readers that are known, by name."""

__all__ = ["CODED_PEERS", "CodedPeer", "Labelled", "Read"]
