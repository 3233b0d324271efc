"""`rcdn evaluate`: the figures of the docs, each by one command.

To add a suite: write a function in one of these files (parameters are the options, the docstring is the help, heavy
imports inside) and add it below.
"""

from __future__ import annotations

import typer

from rcdn_lab.cli.evaluate import (
    calibration,
    coded,
    coded_cameras,
    deltille,
    detection,
    figures,
    guided,
    patterns,
    real_rigs,
    rig_shifts,
    rigs,
    selected,
    sieve,
    sweep,
    table4,
    tables,
    verdicts,
    worst_case,
)

app = typer.Typer(
    no_args_is_help=True,
    help="Measure: every figure in the docs comes from one of these.",
    short_help="Measure the figures of the docs.",
    rich_markup_mode=None,
)
app.command("scenes")(detection.scenes)
app.command("hard")(detection.hard)
app.command("detections")(detection.detections)
app.command("recovery")(detection.recovery)
app.command("sweep")(sweep.sweep)
app.command("coded")(coded.coded)
app.command("coded-cameras")(coded_cameras.coded_cameras)
app.command("guided")(guided.guided)
app.command("real-rigs")(real_rigs.real_rigs)
app.command("rig-shifts")(rig_shifts.rig_shifts)
app.command("rigs")(rigs.rigs)
app.command("selected")(selected.selected)
app.command("patterns")(patterns.patterns)
app.command("sieve")(sieve.sieve)
app.command("worst-case")(worst_case.worst_case)
app.command("calibration")(calibration.calibration)
app.command("repeatability")(calibration.repeatability)
app.command("trust")(calibration.trust)
app.command("verdicts")(verdicts.verdicts)
app.command("table2")(tables.table2)
app.command("table3")(tables.table3)
app.command("seeds")(tables.seeds)
app.command("table4")(table4.table4)
app.command("fig4")(figures.fig4)
app.command("fig5")(figures.fig5)
app.command("fig6")(figures.fig6)
app.command("deltille")(deltille.deltille)
