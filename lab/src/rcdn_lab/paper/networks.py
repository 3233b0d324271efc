"""The networks of the paper's tables, and the names of their weights."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Network:
    """A row of Table 3: its name there, the weights (for `load_network`), and the thresholds tuned for its loss (Table
    2). `again`: the row whose network this one is, trained otherwise."""

    row: str
    model: str
    std_factor: float = 0.8
    max_fraction: float = 0.41
    again: str = ""


NETWORKS = {
    network.row: network
    for network in (
        Network("A", "tables/a"),
        Network("B", "tables/b"),
        Network("C", "tables/c"),
        Network("D-1", "tables/d"),
        Network("D-3", "tables/d3"),
        Network("E-16", "tables/e16"),
        Network("E-32", "tables/e"),
        Network("F", "paper"),
        Network("G", "tables/g"),
        Network("H", "tables/h"),
        Network("MATE", "tables/mate", std_factor=1.7, max_fraction=0.57),
        Network("F, as all", "tables/f", again="F"),
        Network("A, seed 2", "tables/a-2", again="A"),
        Network("B, seed 2", "tables/b-2", again="B"),
        Network("C, seed 2", "tables/c-2", again="C"),
        Network("D-1, seed 2", "tables/d-2", again="D-1"),
        Network("D-3, seed 2", "tables/d3-2", again="D-3"),
        Network("E-16, seed 2", "tables/e16-2", again="E-16"),
        Network("E-32, seed 2", "tables/e-2", again="E-32"),
        Network("F, as all, seed 2", "tables/f-2", again="F"),
        Network("G, seed 2", "tables/g-2", again="G"),
        Network("H, seed 2", "tables/h-2", again="H"),
        Network("MATE, seed 2", "tables/mate-2", again="MATE", std_factor=1.7, max_fraction=0.57),
    )
}
"""Row → network. MATE is net A trained with the squared loss: only with that interpretation do rows of Tables 2 and 3
agree digit by digit."""

TWICE = {row: (row, f"{row}, seed 2") for row, network in NETWORKS.items() if not network.again}
TWICE["F"] = ("F, as all", "F, as all, seed 2")
"""Row of Table 3 → the two networks of it that were trained by the budget of all rows, from two seeds."""
