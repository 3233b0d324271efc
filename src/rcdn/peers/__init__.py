"""Other people's detectors on our pictures, all in our words and our pixels. One that isn't installed says so and is passed over."""

from rcdn.peers import boofcv, calibtargets, chesscorners, mrgingham, opencv
from rcdn.peers.base import Find, Grid, Peer, quiet

PEERS = {
    peer.name: peer
    for peer in (
        opencv.SB,
        opencv.CLASSIC,
        boofcv.GIVEN,
        boofcv.FREE,
        calibtargets.DEFAULT,
        calibtargets.PYRAMID,
        chesscorners.CORNERS,
        mrgingham.MRGINGHAM,
    )
}
"""All peers that are known, by name."""

__all__ = ["PEERS", "Find", "Grid", "Peer", "quiet"]
