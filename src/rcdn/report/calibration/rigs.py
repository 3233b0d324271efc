"""The report of a rig of many cameras."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from rcdn.calibration.facts import Facts, measure
from rcdn.calibration.limits import LIMITS, RIG_LIMITS, growth
from rcdn.calibration.rig_facts import judged_rig, least_known
from rcdn.io import write_text
from rcdn.report.calibration import gallery, page, sections, style, verdict
from rcdn.report.calibration.markup import Html, counted, each, join, number, pixels, tag, value_and_std
from rcdn.report.calibration.pictures import Pictures
from rcdn.report.calibration.rig_space import rig_figure
from rcdn.types import RigCalibration, RigPair

OVERLAYS = 2_000_000
"""maximum size of the drawings of all views, bytes; above it they are left out with a note"""
HIGH = 1.5
"""multiple of the overall RMS above which a pair's RMS is highlighted"""

WORDS = (
    (
        "Centre, ± mm",
        "Where a camera stands in the frame of the first one, and the root of the sum of its variances along three axes; by the scatter of whole "
        "moments, since boards of one moment err together.",
    ),
    (
        "Distance from epipolar planes",
        "A corner in one picture pins its partner in another one to a plane. Its distance from it, px, root mean square over both pictures, in "
        "moments held out: for each fifth of them, lenses and places were solved for without it. Boards and their shapes play no part in the "
        "distance.",
    ),
    ("Agree", "Boards that both cameras saw whole at one moment, and that lie where the others have them."),
    *page.WORDS,
)


def write_rig_report(
    path: str | Path,
    found: RigCalibration,
    shown: Mapping[str, Pictures] | None = None,
    title: str = "Calibration of a rig",
) -> None:
    """Write the report of a rig to `path`: as `write_report`; `shown`: the pictures of each camera, by its name."""
    write_text(path, report(found, shown, title))


def report(
    found: RigCalibration, shown: Mapping[str, Pictures] | None = None, title: str = "Calibration of a rig"
) -> str:
    """The text of the page that `write_rig_report` writes."""
    judged = (found if found.verdict.judged else judged_rig(found)).verdict
    weakest, partner = least_known(found) or ("", "")
    facts = {name: measure(found.cameras[name]) for name in found.rig.names}
    limits = [*RIG_LIMITS.values(), *LIMITS.values()]
    hint = verdict.limits_hint(max((c.image_size for c in found.rig.cameras), key=growth))
    head = join(
        verdict.banner(judged, _summary(found)),
        _key_figures(found, weakest),
        page.section("why", "The reasons", verdict.reasons(judged, (), limits, hint)),
    )
    parts = [
        ("rig", "Where the cameras stand", page.pair(rig_figure(found, weakest), _places(found, weakest, partner))),
        ("pairs", "Pair by pair", _pairs(found)),
        *([("boards", "Boards fixed to each other", _boards(found))] if found.fixed_boards else []),
        ("numbers", "Each camera", _cameras(found)),
        (
            "sensor",
            "Over the sensors",
            _by_camera(found, facts, lambda c, f, whose: sections.sensor_figures(c, f, whose)),
        ),
        (
            "residuals",
            "Residuals",
            _by_camera(found, facts, lambda c, f, whose: sections.residual_figures(c, f, whose)),
        ),
    ]
    meaning = ("meaning", "What the figures mean", sections.definitions(WORDS))
    rest = sum(len(html.encode()) for _, _, html in [*parts, meaning]) + len(head.encode()) + len(style.SHEET)
    parts += [("views", "Every picture", _galleries(found, shown or {}, page.LARGEST - page.SPARE - rest)), meaning]
    views = sum(len(found.cameras[name].views) for name in found.rig.names)
    return page.page(
        title, _subtitle(found), head, parts, f"From {counted(views, 'view')} of {counted(len(found.boards), 'board')}."
    )


def _subtitle(found: RigCalibration) -> str:
    lenses = dict.fromkeys("{} {} × {} px".format(c.model, *c.image_size) for c in found.rig.cameras)
    return f"{counted(len(found.rig), 'camera')} ({', '.join(lenses)}), {counted(len(found.boards), 'board')} seen by one or more"


def _summary(found: RigCalibration) -> str:
    gaps = [p.epipolar for p in found.pairs if np.isfinite(p.epipolar)]
    rows = (
        f" In moments held out, corners that two cameras saw lie within {pixels(max(gaps))} (RMS, the worst pair) of each other’s epipolar planes."
        if gaps
        else ""
    )
    return f"{counted(len(found.rig), 'camera')} of {len(found.cameras)} are connected; they explain the corners to {pixels(found.rms)} (RMS).{rows}"


def _key_figures(found: RigCalibration, weakest: str) -> Html:
    gaps = [p.epipolar for p in found.pairs if np.isfinite(p.epipolar)]
    return sections.key_figures([
        ("RMS, all cameras", pixels(found.rms), ""),
        ("Epipolar distance", pixels(float(np.median(gaps))) if gaps else "–", "held out, median of the pairs"),
        ("Cameras connected", f"{len(found.rig)}", f"of {len(found.cameras)}"),
        ("Known least", weakest or "–", f"± {_millimetres(found, weakest)} mm" if weakest else ""),
        ("Boards", f"{len(found.boards)}", ""),
        ("Lenses given", f"{len(found.given)}" if found.given else "none", ""),
    ])  # fmt: skip


def _millimetres(found: RigCalibration, name: str) -> str:
    cov = found.rig.centre_covariance(name)
    return "–" if cov is None else number(1000 * float(np.sqrt(np.trace(cov))), 2)


def _table(caption: str, heads: list[str], rows: list[Html]) -> Html:
    """A table with names in the first column and numbers in the others."""
    words = (tag("th", h, scope="col", class_="n" if k else None) for k, h in enumerate(heads))
    head = tag("thead", tag("tr", *words))
    return tag("div", tag("table", tag("caption", caption), head, tag("tbody", each(rows))), class_="card wide")


def _row(name: object, cells: list[str], mark: str = "") -> Html:
    note = tag("span", mark, class_="tag out") if mark else None
    return tag("tr", tag("th", name, " ", note, scope="row"), *(tag("td", c, class_="n") for c in cells))


def _places(found: RigCalibration, weakest: str, partner: str) -> Html:
    """The position of each camera, and advice on further pictures."""
    rig, rows = found.rig, []
    for k, name in enumerate(rig.names):
        cov = None if rig.covariance is None else rig.covariance[6 * k : 6 * k + 6, 6 * k : 6 * k + 6]
        place = rig.centre_covariance(name)
        spread = np.full(3, np.nan) if place is None else 1000 * np.sqrt(np.diag(place))
        xyz = [value_and_std(v, s)[0] for v, s in zip(1000 * rig.centre(name), spread, strict=True)] if k else ["0"] * 3
        turn = "–" if cov is None or not k else number(float(np.degrees(np.sqrt(np.trace(cov[:3, :3])))), 2)
        rows.append(
            _row(name, [*xyz, _millimetres(found, name) if k else "–", turn], "least" if name == weakest else "")
        )
    table = _table(
        f"Centres in the frame of {rig.names[0]}, with standard deviations",
        ["camera", "x, mm", "y, mm", "z, mm", "± mm", "turned ± °"],
        rows,
    )
    apart = [name for name in found.cameras if name not in rig.names]
    words = [f"{', '.join(apart)}: no board connects them; where they stand isn’t known."] if apart else []
    if weakest:
        both = f" and {partner}" if partner else ""
        words.append(
            f"What to film: the board before {weakest}{both}, whole in both pictures, tilted to several sides, near and far."
        )
    return tag("div", table, *(tag("p", text, class_="card") for text in words), class_="column")


def _pairs(found: RigCalibration) -> Html:
    """A table with a row for each pair of cameras that share boards."""
    order = sorted(found.pairs, key=lambda p: -p.epipolar if np.isfinite(p.epipolar) else 0)
    rows = [
        _row(f"{p.first} – {p.second}", _pair_cells(found, p), "high" if p.rms > HIGH * found.rms else "")
        for p in order
    ]
    every = len(found.rig) * (len(found.rig) - 1) // 2
    caption = f"{counted(len(rows), 'pair')} of {every} saw boards together, the worst first; epipolar distances are of moments that were held out"
    heads = ["pair", "shared boards", "agree", "RMS, px", "epipolar, px", "apart, mm", "± mm"]
    return _table(caption, heads, rows)


def _pair_cells(found: RigCalibration, p: RigPair) -> list[str]:
    rms, gap = (pixels(v).removesuffix(" px") for v in (p.rms, p.epipolar))
    if not {p.first, p.second} <= set(found.rig.names):
        return [str(p.shared), str(p.used), rms, gap, "–", "–"]
    T, cov = found.rig.relative(p.first, p.second)
    far = float(np.linalg.norm(T[:3, 3]))
    along = T[:3, 3] / max(far, 1e-12)
    # a small rotation of the second camera changes t by ω × t, which doesn't change its length
    spread = float("nan") if cov is None else float(np.sqrt(max(float(along @ cov[3:, 3:] @ along), 0.0)))
    return [str(p.shared), str(p.used), rms, gap, *value_and_std(1000 * far, 1000 * spread)]


def _boards(found: RigCalibration) -> Html:
    """The places of boards that are fixed to each other."""
    rows, names = [], {b.target: b.name for b in found.fixed_boards}
    for board in found.fixed_boards:
        if board.target == board.first:
            rows.append(_row(board.name, ["–"] * 6, "first"))
            continue
        spread = 1000 * np.sqrt(np.diag(board.cov)[3:])
        cells = [value_and_std(v, s)[0] for v, s in zip(1000 * board.T_first_board[:3, 3], spread, strict=True)]
        turn = np.degrees(np.arccos(np.clip((np.trace(board.T_first_board[:3, :3]) - 1) / 2, -1, 1)))
        sure = float(np.degrees(np.sqrt(np.trace(board.cov[:3, :3]))))
        cells += [number(float(np.sqrt((spread**2).sum())), 2), *value_and_std(float(turn), sure)]
        rows.append(_row(f"{board.name}, to {names[board.first]}", cells))
    caption = "Each board’s corner (0, 0) in the axes of the first board of its set, and how far it is turned, with standard deviations"
    return _table(caption, ["board", "x, mm", "y, mm", "z, mm", "± mm", "turned, °", "± °"], rows)


def _cameras(found: RigCalibration) -> Html:
    cards = []
    for k, name in enumerate(found.rig.names):
        camera = found.cameras[name]
        given = tag("span", "given", class_="tag") if name in found.given else None
        cards.append(
            tag(
                "div", tag("h3", name, " ", given), tag("div", sections.parameters(camera), class_="card wide"),
                tag("div", sections.copyable_camera(camera.camera, f"-{k}"), class_="card"), class_="column",
            )
        )  # fmt: skip
    return each([page.pair(*cards[k : k + 2]) for k in range(0, len(cards), 2)])


def _by_camera(found: RigCalibration, facts: Mapping[str, Facts], draw: Callable[..., tuple[Html, ...]]) -> Html:
    """Drawings of all cameras, a row for each camera."""
    return each([page.pair(*draw(found.cameras[name], facts[name], f", {name}")) for name in found.rig.names])


def _galleries(found: RigCalibration, shown: Mapping[str, Pictures], room: int) -> Html:
    """All pictures of all cameras, as far as they fit into `room` bytes."""

    def made(photographs: Mapping[str, Pictures], budget: int) -> Html:
        return each([
            join(tag("h3", name), gallery.gallery(found.cameras[name], photographs.get(name), budget, f"{k}-", 4))
            for k, name in enumerate(found.rig.names)
        ])  # fmt: skip

    bare = made({}, 0)
    taken = len(bare.encode())
    if taken > min(OVERLAYS, room):
        return tag("p", "There are too many pictures to draw each; `--json` holds every residual.", class_="soft")
    return made(shown, max(room - taken, 0) // len(found.rig)) if shown else bare
