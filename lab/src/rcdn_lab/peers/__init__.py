"""Other detectors, converted to our conventions and pixel coordinates. One that is not installed is skipped with the
reason.

Available detectors are called unchanged. Those that the RCDN paper compares with and that cannot be installed are
implemented here (`chess`, `mate`, `geiger`, `rochade`, `ocpad`, `ocamcalib`; docs/peers.md).
"""

from rcdn_lab.peers import (
    boofcv,
    calibtargets,
    chess,
    chesscorners,
    geiger,
    mate,
    mrgingham,
    ocamcalib,
    ocpad,
    opencv,
    rochade,
)
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
        ocpad.OCPAD,
        ocamcalib.OCAMCALIB,
    )
}
"""All known peers, by name."""

__all__ = ["PEERS", "Find", "Grid", "Peer", "quiet"]
