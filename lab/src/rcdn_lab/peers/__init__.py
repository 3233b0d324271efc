"""Other detectors on our pictures, all in our words and our pixels. One that isn't installed says so and is passed over.

Those of others are called as they are. Those that the RCDN paper compares with and that can't be installed are written here
(`chess`, `mate`, `geiger`, `rochade`; docs/peers.md).
"""

from rcdn_lab.peers import boofcv, calibtargets, chess, chesscorners, geiger, mate, mrgingham, opencv, rochade
from rcdn_lab.peers.base import Find, Grid, Peer, quiet

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
        chess.CHESS,
        mate.MATE,
        geiger.GEIGER,
        rochade.ROCHADE,
    )
}
"""All peers that are known, by name."""

__all__ = ["PEERS", "Find", "Grid", "Peer", "quiet"]
