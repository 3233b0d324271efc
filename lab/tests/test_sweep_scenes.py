"""Pictures of a sweep show what their setting says: measured in the picture or in its geometry."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import erf

from rcdn.errors import ConfigError
from rcdn.geometry import apply_homography, homography, unproject
from rcdn.synthetic import truth
from rcdn.synthetic.degrade import focus
from rcdn.synthetic.render import irradiance
from rcdn.synthetic.surface import board_to_pixels, rays_to_board, viewing_cosine
from rcdn_lab.sweep import FACTORS, picture, scene
from rcdn_lab.sweep.pictures import seed_of
from rcdn_lab.sweep.settings import BASE

LEVELS = [(factor, level) for factor, levels in FACTORS.items() for level in levels]


def made(seed=5, size=(9, 6), **changes):
    """The scene of a base setting with changes."""
    return scene(replace(BASE, **changes), [1, seed], size)


def exposure(where):
    """The scene without noise, grey levels."""
    return focus(irradiance(where), where.sensor)


def only_board(where):
    return truth(where)[0]


@pytest.mark.parametrize(("factor", "level"), LEVELS, ids=lambda v: v)
def test_all_corners_are_demanded_but_those_that_the_setting_hides(factor, level):
    setting = FACTORS[factor][level]
    where = scene(setting, seed_of(factor, level, 0))
    boards = truth(where)
    assert len(boards) == setting.boards
    for board in boards:
        seen = board.xy[board.visible]
        assert ((seen >= 0) & (seen <= [where.width - 1, where.height - 1])).all()
        if not setting.cover and not setting.cut and (setting.tilt or 0) < 75:
            assert board.visible.all()
        assert board.visible.sum() >= 18


def test_settings_differ_from_the_base_in_their_factor_only():
    for name in ("noise", "blur", "tilt", "square", "contrast", "jpeg"):
        for setting in FACTORS[name].values():
            assert replace(setting, **{name: getattr(BASE, name)}) == BASE
    assert len({repr(s) for s in FACTORS["two"].values()} - {repr(s) for f in FACTORS.values() for s in f}) == len(
        FACTORS["two"]
    )


def test_a_seed_is_a_picture():
    one, two = (picture(BASE, seed_of("noise", "3", 4)) for _ in range(2))
    assert one.image.tobytes() == two.image.tobytes()
    assert one.image.tobytes() != picture(BASE, seed_of("noise", "3", 5)).image.tobytes()
    assert one.image.tobytes() != picture(BASE, seed_of("blur", "3", 4)).image.tobytes()


def middle(where, half=40):
    """The part of the frame around the board's middle."""
    x, y = only_board(where).xy.mean(axis=0).astype(int)
    return np.s_[y - half : y + half, x - half : x + half]


@pytest.mark.parametrize("noise", [0, 5, 20])
def test_noise(noise):
    where = made(noise=noise)  # on the board no grey level is near black or white
    left = (picture(replace(BASE, noise=noise), [1, 5]).image - exposure(where))[middle(where)]
    assert np.abs(left).max() <= (0.5001 if not noise else 6 * noise)
    assert left.std() == pytest.approx(np.hypot(noise, 0.29), abs=0.03 * noise + 0.15)


@pytest.mark.parametrize("blur", [1, 3, 5])
def test_blur(blur):
    """Largest difference over two px of an edge of σ, its pixels' width included: upright and between two pixels the
    least, at 45° the most."""
    where = made(blur=blur, square=30, tilt=0)
    dy, dx = np.gradient(exposure(where))
    steepest, sigma = np.hypot(dx, dy)[middle(where)].max(), np.sqrt(blur**2 + 1 / 12)
    upright, slanted = 85 * erf(1 / (np.sqrt(2) * sigma)), 85 * np.sqrt(2) * erf(0.5 / sigma)
    assert 0.95 * upright < steepest < 1.01 * slanted


def test_contrast():
    for contrast in (170, 50, 20):
        where = made(contrast=contrast, square=30)
        assert np.ptp(exposure(where)[middle(where)]) == pytest.approx(contrast, abs=0.6)


@pytest.mark.parametrize("lens", [{}, {"barrel": 1.5}, {"fisheye": 150}], ids=["pinhole", "barrel", "fisheye"])
@pytest.mark.parametrize("tilt", [0, 45, 70])
def test_tilt(tilt, lens):
    for seed in range(3):
        where = made(seed, tilt=tilt, **lens)
        cosine = viewing_cosine(where.boards[0], np.array([[4, 2.5]]))[0]
        assert np.rad2deg(np.arccos(np.clip(cosine, -1, 1))) == pytest.approx(tilt, abs=1e-3)


@pytest.mark.parametrize("square", [6, 14, 25, 40, 60])
def test_square(square):
    """The area of one in the middle, for off its axis a lens stretches it."""
    xy = only_board(made(square=square, tilt=0)).xy.reshape(6, 9, 2)
    along, down = (xy[2, 5] - xy[2, 3]) / 2, (xy[3, 4] - xy[1, 4]) / 2
    assert np.sqrt(abs(np.cross([*along, 0], [*down, 0])[2])) == pytest.approx(square, rel=0.01)


@pytest.mark.parametrize("k", [0.5, 1.5, 2.5])
def test_barrel(k):
    """x ÷ (1 − k r²), r in widths of the picture: at the frame's corner r = 0.625, and 2.5 makes nearly 90° of it."""
    where = made(barrel=k)
    ray = unproject(where.camera, np.array([-0.5, -0.5]))
    r = np.hypot(0.5, 0.375)
    assert np.hypot(ray[0], ray[1]) / ray[2] == pytest.approx(r / (1 - k * r * r), rel=1e-9)


@pytest.mark.parametrize("angle", [120, 150, 180])
def test_fisheye(angle):
    ends = unproject(made(fisheye=angle).camera, np.array([[-0.5, 239.5], [639.5, 239.5]]))
    assert np.rad2deg(np.arctan2(ends[:, 0], ends[:, 2])) == pytest.approx([-angle / 2, angle / 2])


def flatness(where):
    """How far, px, the corners of a board are from a plane's picture."""
    board = only_board(where)
    H = homography(board.ij, board.xy)
    return np.linalg.norm(apply_homography(H, board.ij) - board.xy, axis=1).max()


def test_bent_boards_are_not_flat():
    assert flatness(made()) < 1e-6
    for bend in FACTORS["bend"].values():
        assert max(flatness(made(seed, bend=bend.bend)) for seed in range(3)) > 1


def test_no_ray_sees_a_bent_board_where_it_is_not():
    """Rays that pass by the sheet don't end on it somewhere."""
    for seed in range(3):
        where = scene(FACTORS["bend"]["cylinder 6"], seed_of("bend", "cylinder 6", seed))
        spec = where.boards[0]
        pixels = np.stack(np.meshgrid(np.arange(0, 640, 5), np.arange(0, 480, 5)), axis=-1).reshape(-1, 2).astype(float)
        uv = np.stack(rays_to_board(spec, unproject(where.camera, pixels)), axis=1)
        seen = np.isfinite(uv).all(axis=1)
        assert seen.sum() > 300
        assert board_to_pixels(spec, where.camera, uv[seen]) == pytest.approx(pixels[seen], abs=1e-3)


@pytest.mark.parametrize("share", [0.2, 0.33, 0.5])
def test_cut(share):
    for seed in range(3):
        board = only_board(made(seed, cut=share))
        assert 1 - board.visible.mean() == pytest.approx(share, abs=0.061)


def test_a_covered_quadrant():
    for seed in range(4):
        board = only_board(made(seed, cover="quadrant"))
        hidden = ~board.visible & ~board.ignore
        assert 10 <= hidden.sum() <= 17
        assert len({(i > 4, j > 2) for i, j in board.ij[hidden].tolist() if i != 4}) == 1


def test_a_bar_lies_across_the_board():
    for seed in range(4):
        board = only_board(made(seed, cover="bar", bar=2))
        assert (~board.visible).sum() >= 6
        assert board.visible.sum() >= 18


def test_shadow_falls_on_half_the_board():
    where = made(shadow=0.25)
    bright = replace(where, light=replace(where.light, shadows=()))
    share = irradiance(where) / irradiance(bright)
    assert share.min() == pytest.approx(0.25, abs=1e-4)
    assert share.max() == 1
    x, y = only_board(where).xy.round().astype(int).T
    assert 0.25 < (share[y, x] < 0.5).mean() < 0.75


def test_light_falls_off():
    """Over the whole width or height, or a bit less than over the diagonal; nothing is brighter than it was."""
    plain = irradiance(replace(made(falloff=5), light=replace(made().light, gx=0.0, gy=0.0)))
    where = made(falloff=5)
    gain = irradiance(where) / plain * where.sensor.gain
    assert np.hypot(where.light.gx, where.light.gy) == pytest.approx(np.log(5))
    assert 5 * 0.95 < gain.max() / gain.min() < 5**1.42
    assert gain.max() < 5**0.22


@pytest.mark.parametrize("count", [2, 3, 4, 6])
def test_boards_lie_apart(count):
    boards = truth(made(boards=count))
    for k, one in enumerate(boards):
        for other in boards[k + 1 :]:
            gaps = np.linalg.norm(one.xy[:, None] - other.xy[None], axis=-1)
            assert gaps.min() > one.pitch.min()


def test_other_sizes_of_board():
    assert len(only_board(made(size=(7, 7))).xy) == 49


def test_a_board_that_does_not_fit_is_told():
    with pytest.raises(ConfigError, match="fits"):
        made(square=30, size=(40, 30))
