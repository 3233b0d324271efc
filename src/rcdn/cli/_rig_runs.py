"""The work of `rcdn calibrate --rig`: boards of all cameras found, their moments told, the rig solved, said and written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rcdn.cli import _talk
from rcdn.cli._behind import seen_from_behind
from rcdn.cli._calibration_outputs import Outputs
from rcdn.cli._calibration_runs import Problem, Run, flat
from rcdn.cli._camera_files import write_rig_files
from rcdn.cli._moments import cameras_in, moments_of
from rcdn.cli._spacing import metres
from rcdn.errors import ConfigError, many, present

if TYPE_CHECKING:
    from rcdn.cli._inputs import Gathered, Numbers
    from rcdn.types import Array, Reason, RigCalibration, Verdict


def many_cameras(run: Run, inputs: Sequence[str], problem: Problem, outputs: Outputs) -> Verdict | None:
    """Calibrate the cameras of `inputs`, say what came out, and write it."""
    from rcdn.calibration import calibrate_rig
    from rcdn.cli._camera_text import verdict_line
    from rcdn.io import write_rig_calibration

    cameras = cameras_in(inputs)
    found = _gathered(run, cameras, problem)
    keys, way = moments_of([[image.path for image in got.images] for got in found.values()])
    if way != "name":
        _talk.note(f"note: pictures belong together by {way}")
    moments = {
        name: [k for k, image in zip(each, got.images, strict=True) for _ in image.boards]
        for (name, got), each in zip(found.items(), keys, strict=True)
    }
    sets = {name: flat(got.images) for name, got in found.items()}
    done = calibrate_rig(
        {n: boards for n, (boards, _) in sets.items()},
        metres(problem.spacing),
        moments=moments,
        names={n: pictures for n, (_, pictures) in sets.items()},
        model=problem.model,
        size=run.size,
    )
    for line in [*verdict_line(done.verdict), *rig_lines(done)]:
        _talk.say(line)
    kept = outputs.kept(*(done.cameras[name] for name in done.rig.names))
    run.failed |= not outputs.write(
        kept,
        lambda path: write_rig_files(path, done.rig, outputs.format),
        lambda path: write_rig_calibration(path, done),
        _no_page,
    )
    return done.verdict


def _no_page(path: Path) -> None:
    raise ConfigError(f"{path}: a rig has no report; write everything with --json")


def _gathered(run: Run, cameras: Mapping[str, Sequence[str]], problem: Problem) -> dict[str, Gathered]:
    """The boards of each camera; of videos the frames that were chosen of any of them."""
    found = {name: run.gather(inputs, cameras=len(cameras)) for name, inputs in cameras.items()}
    chosen = _together([got.frames for got in found.values()])
    for name, inputs in cameras.items():
        if chosen and found[name].frames != chosen:
            found[name] = run.gather(inputs, chosen)
        found[name] = seen_from_behind(run, name, inputs, found[name])
        run.check(found[name], problem.spacing)
    return found


def _together(frames: Sequence[Numbers]) -> Numbers:
    """The numbers of the frames that were chosen in any camera's video; () if the cameras don't have as many videos each."""
    if len({len(each) for each in frames}) > 1:
        return ()
    return tuple(tuple(sorted(set().union(*numbers))) for numbers in zip(*frames, strict=True))


def rig_lines(done: RigCalibration) -> list[str]:
    """Where the cameras stand with deviations, the pairs, and what speaks against the rig."""
    rig, lines = done.rig, []
    lines.append(
        f"rig of {len(rig)} cameras: rms {done.rms:.3g} px, {many(len(done.boards), 'board')}; frame of {rig.names[0]}"
    )
    for k, (name, camera, pose) in enumerate(zip(rig.names, rig.cameras, rig.poses, strict=True)):
        centre = -pose.R.T @ pose.t
        place = "at the origin" if not k else f"at {_triple(centre)} m ± {_spread(done, k)}"
        lines.append(f"  {name}: {camera.model}, {place}")
    for pair in done.pairs:
        lines.append(
            f"  {pair.first} – {pair.second}: {pair.used} of {pair.shared} shared boards, rms {pair.rms:.3g} px"
        )
    return lines + _weakest(done) + _against(done.verdict.against if done.verdict else (), rig.names)


def _weakest(done: RigCalibration) -> list[str]:
    """Which of three cameras or more is known least, and before which two to hold the board."""
    import numpy as np

    if done.rig.covariance is None or len(done.rig) < 3:
        return []
    deviations = {name: np.sqrt(np.trace(_place_covariance(done, k))) for k, name in enumerate(done.rig.names) if k}
    name = max(deviations, key=lambda n: deviations[n])
    shared = {p.second if p.first == name else p.first: p.used for p in done.pairs if name in (p.first, p.second)}
    partner = max(shared, key=lambda n: shared[n], default="")
    film = f"; hold the board where it and {partner} both see it, tilted, near and far" if partner else ""
    return [f"  known least: {name}{film}"]


def _against(reasons: Sequence[Reason], names: Sequence[str]) -> list[str]:
    """A line for each action, with what several cameras have in common said once."""
    groups: dict[str, dict[str, list[str]]] = {}
    for found in reasons:
        name = next((n for n in names if found.sentence.startswith(f"{n}: ")), "")
        sentence = found.sentence.removeprefix(f"{name}: ") if name else found.sentence
        groups.setdefault(found.action, {}).setdefault(sentence, []).append(name)
    lines = []
    for action, sentences in groups.items():
        said = [f"{', '.join(who)}: {sentence}" if any(who) else sentence for sentence, who in sentences.items()]
        lines.append(" ".join(["-", *said, action]).rstrip())
    return lines


def _spread(done: RigCalibration, k: int) -> str:
    import numpy as np

    cov = done.rig.covariance
    if cov is None:
        return "unknown"
    far = np.sqrt(np.trace(_place_covariance(done, k)))
    turn = np.degrees(np.sqrt(np.trace(cov[6 * k : 6 * k + 3, 6 * k : 6 * k + 3])))
    return f"{1000 * far:.2g} mm, turned ± {turn:.2g}° (baseline {np.linalg.norm(done.rig.poses[k].t):.4g} m)"


def _place_covariance(done: RigCalibration, k: int) -> Array:
    """(3, 3) of where the centre of camera number `k` is, m²."""
    import numpy as np

    R = done.rig.poses[k].R
    J = np.hstack([np.zeros((3, 3)), -R.T])  # a left turn moves t and R together: the centre keeps its place
    return np.asarray(J @ present(done.rig.covariance, "covariance")[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] @ J.T)


def _triple(values: Array) -> str:
    return "(" + ", ".join(f"{v:.4f}" for v in values) + ")"
