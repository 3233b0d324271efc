"""The steps of `rcdn calibrate --rig`: detection in all cameras, grouping by moment, calibration of the rig, printed
summary and output files."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from math import isnan
from typing import TYPE_CHECKING

from rcdn.batch.calibration_outputs import Outputs
from rcdn.batch.calibration_runs import BoardReader, Problem, flat, pictures_of
from rcdn.batch.camera_files import rig_refusal, write_rig_files
from rcdn.batch.known_cameras import camera_paths, known_cameras
from rcdn.batch.moments import cameras_in, chosen_by_any, moments_note, moments_of
from rcdn.batch.pairs import stems
from rcdn.batch.rig_lags import in_step, with_neighbours
from rcdn.batch.video_rates import rates_note
from rcdn.errors import CalibrationError, ConfigError, many
from rcdn.terminal import console
from rcdn.terminal.spacing import metres

if TYPE_CHECKING:
    from rcdn.batch.inputs import Gathered, Numbers
    from rcdn.batch.moment_file import MomentFile
    from rcdn.types import Array, Camera, FixedBoard, Reason, RigCalibration, Verdict

LISTED = 6
"""recommendations in the summary of a rig"""
WAY_OUT = "name those of one moment: --moments moments.txt, a file with a line for each, a name for each camera"
"""what to do where names don't tell which pictures belong together"""


def many_cameras(reader: BoardReader, inputs: Sequence[str], problem: Problem, outputs: Outputs) -> Verdict | None:
    """Calibrate the cameras of `inputs`, print a summary, and write the outputs."""
    from rcdn.io import is_video, write_rig_calibration
    from rcdn.report.calibration import write_rig_report
    from rcdn.terminal.camera_text import verdict_line

    cameras = cameras_in(inputs)
    if problem.moments is not None and any(is_video(path) for each in cameras.values() for path in each):
        raise ConfigError("--moments is for pictures and saved detections; frames of videos belong together by number")
    known = known_cameras(problem.cameras, list(cameras))
    outputs = outputs.without_refused(
        lambda path: rig_refusal(path, outputs.format, list(cameras), problem.model, known)
    )
    outputs.check_rig_files(list(cameras), camera_paths(problem.cameras))
    found, done = solved(reader, cameras, problem, known)
    for line in [*verdict_line(done.verdict, several=True), *rig_lines(done)]:
        console.print_line(line)
    every = [image.path for got in found.values() for image in got.images]
    kept = outputs.kept(*(done.cameras[name] for name in done.rig.names if name not in known))
    reader.failed |= not outputs.write(
        kept,
        lambda path: write_rig_files(path, done.rig, outputs.format),
        lambda path: write_rig_calibration(path, done),
        lambda path: write_rig_report(
            path, done, {n: pictures_of(done.cameras[n], got, outputs, every) for n, got in found.items()}
        ),
    )
    return done.verdict


def solved(
    reader: BoardReader, cameras: Mapping[str, Sequence[str]], problem: Problem, known: Mapping[str, Camera]
) -> tuple[dict[str, Gathered], RigCalibration]:
    """The detections of each camera, and the rig. Where time is to be corrected and not all cameras agree, other frames
    of their videos are used: those that fit to how late each one is."""
    found = _gathered(reader, cameras, problem)
    try:
        done = _calibrated(reader, found, problem, known)
    except CalibrationError:
        if (again := in_step(reader, cameras, found, problem, known)) is None:
            raise
    else:
        if len(done.components) == 1 or (again := in_step(reader, cameras, found, problem, known)) is None:
            return found, done
    return again, _calibrated(reader, again, problem, known)


def _calibrated(
    reader: BoardReader, found: Mapping[str, Gathered], problem: Problem, known: Mapping[str, Camera]
) -> RigCalibration:
    from rcdn.calibration import calibrate_rig

    keys = _moments(found, problem.moments)
    moments = {
        name: [k for k, image in zip(each, got.images, strict=True) for _ in image.boards]
        for (name, got), each in zip(found.items(), keys, strict=True)
    }
    sets = {name: flat(got.images) for name, got in found.items()}
    return calibrate_rig(
        {n: boards for n, (boards, _) in sets.items()},
        metres(problem.spacing),
        moments=moments,
        names={n: pictures for n, (_, pictures) in sets.items()},
        model=problem.model,
        size=reader.size,
        cameras=known,
        correct_time=problem.correct_time,
        fixed_boards=problem.fixed_boards,
    )


def _moments(found: Mapping[str, Gathered], file: MomentFile | None) -> list[list[str]]:
    """For each camera the moments of its pictures, by the file of `--moments` if there is one; prints the rule used
    where names are ambiguous."""
    pictures = {name: [image.path for image in got.images] for name, got in found.items()}
    if file is not None:
        return file.match(pictures, {name: [failed.name for failed in got.failures] for name, got in found.items()})
    if all(got.one_video for got in found.values()):
        return [stems(names) for names in pictures.values()]
    keys, way = moments_of([*pictures.values()], WAY_OUT)
    if note := moments_note(keys, way, WAY_OUT):
        console.note(note)
    return keys


def _gathered(reader: BoardReader, cameras: Mapping[str, Sequence[str]], problem: Problem) -> dict[str, Gathered]:
    """The detections of each camera; of videos, all frames that were chosen in the video of any camera."""
    from rcdn.types.limits import READ_IN_A_MIRROR

    found = {
        name: reader.gather(inputs, cameras=len(cameras), silent=READ_IN_A_MIRROR) for name, inputs in cameras.items()
    }
    if note := rates_note(found.values()):
        console.note(note)
    chosen = chosen_by_any([got.frames for got in found.values()])
    chosen = _and_beside_them(chosen) if problem.correct_time else chosen
    for name, inputs in cameras.items():
        if chosen and found[name].frames != chosen:
            found[name] = reader.gather(inputs, chosen, silent=READ_IN_A_MIRROR)
        found[name] = reader.seen_from_behind(name, inputs, found[name])
        reader.check(found[name], problem.spacing)
    return found


def _and_beside_them(frames: Numbers) -> Numbers:
    """The frame numbers of each video together with those before and after them, up to the last one."""
    return tuple(tuple(sorted(n for n in with_neighbours(each) if 0 <= n <= max(each))) for each in frames)


def rig_lines(done: RigCalibration) -> list[str]:
    """The summary of a rig: camera positions with standard deviations, pairs of cameras, and the reasons against the
    result."""
    from rcdn.calibration.rig_facts import lateness

    rig, lines = done.rig, []
    lines.append(
        f"rig of {len(rig)} cameras: rms {done.rms:.3g} px, {many(len(done.boards), 'board')}; frame of {rig.names[0]}"
    )
    for k, (name, camera) in enumerate(zip(rig.names, rig.cameras, strict=True)):
        place = "at the origin" if not k else f"at {_triple(rig.centre(name))} m ± {_spread(done, k)}"
        lens = f"{camera.model} as given" if name in done.given else camera.model
        lines.append(f"  {name}: {lens}, {place}")
    for pair in done.pairs:
        lines.append(
            f"  {pair.first} – {pair.second}: {pair.used} of {pair.shared} shared boards, rms {pair.rms:.3g} px"
        )
    lines += [
        f"  {name}: brought into step, {lateness(done.shifts[name])}"
        for name in done.corrected
        if done.shifts is not None
    ]
    lines += [_board_line(b) for b in done.fixed_boards if b.target != b.first]
    return lines + _weakest(done) + _against(done.verdict.against, done.cameras)


def _board_line(board: FixedBoard) -> str:
    import numpy as np

    from rcdn.types import translation_covariance

    spread = 1000 * np.sqrt(np.trace(translation_covariance(board.T_first_board, board.cov)))
    return f"  {board.name}: fixed at {_triple(board.T_first_board[:3, 3])} m ± {spread:.2g} mm of the first board"


def _weakest(done: RigCalibration) -> list[str]:
    """A line on the least well determined camera of three or more, and on the two cameras to show the board to."""
    from rcdn.calibration.rig_facts import least_known

    found = least_known(done)
    if found is None:
        return []
    name, partner = found
    film = f"; hold the board where it and {partner} both see it, tilted, near and far" if partner else ""
    return [f"  known least: {name}{film}"]


def _against(reasons: Sequence[Reason], names: Collection[str]) -> list[str]:
    """A line for each of the first LISTED recommended actions: of each check the sentence of the camera with the worst
    result, and the names of the other cameras with a result against them. `names`: those of all cameras."""
    actions: dict[str, dict[str, list[tuple[str, Reason]]]] = {}
    for found in reasons:
        camera, _, check = found.key.rpartition(".")
        name = camera if camera in names else ""
        actions.setdefault(found.action, {}).setdefault(check, []).append((name, found))
    lines = [
        " ".join(["-", *(_worst(each) for each in checks.values()), action]).rstrip()
        for action, checks in actions.items()
    ]
    more = len(lines) - LISTED
    rest = [f"- {many(more, 'other recommendation')}: see the report (--report)"] if more > 0 else []
    return lines[:LISTED] + rest


def _worst(results: Sequence[tuple[str, Reason]]) -> str:
    """The sentence of the worst of one check's results, after the names of the cameras that it is about, and the names
    of the other cameras."""
    ordered = sorted(results, key=lambda result: _severity(result[1]), reverse=True)
    sentences = [(name, found.sentence.removeprefix(f"{name}: ")) for name, found in ordered]
    first = sentences[0][1]
    same, others = ([name for name, text in sentences if name and (text == first) == alike] for alike in (True, False))
    sentence = f"{', '.join(same)}: {first}" if same else first
    return f"{sentence} Similarly {', '.join(others)}." if others else sentence


def _severity(found: Reason) -> tuple[int, float]:
    """The level, then how far the value is beyond its limit; infinitely far without a value."""
    from rcdn.types import LEVELS

    beyond = abs(found.value - found.limit)
    return LEVELS.index(found.level), float("inf") if isnan(beyond) else beyond


def _spread(done: RigCalibration, k: int) -> str:
    import numpy as np

    rig = done.rig
    cov, place = rig.covariance, rig.centre_covariance(rig.names[k])
    if cov is None or place is None:
        return "unknown"
    turn = np.degrees(np.sqrt(np.trace(cov[6 * k : 6 * k + 3, 6 * k : 6 * k + 3])))
    far = np.linalg.norm(rig.poses[k].t)
    return f"{1000 * np.sqrt(np.trace(place)):.2g} mm, turned ± {turn:.2g}° (baseline {far:.4g} m)"


def _triple(values: Array) -> str:
    return "(" + ", ".join(f"{v:.4f}" for v in values) + ")"
