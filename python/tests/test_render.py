"""Text, pictures and the window."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled

import cpp_rl_gym
from cpp_rl_gym.picture import AGENT, REACHED, REACHED_TILE, TARGET, VISITED, WALL, picture
from support import DOWN, LEFT, RIGHT, make, make_vec


def test_text() -> None:
    env = make(".T.\n#.T", render_mode="ansi")
    env.reset(options={"start": (0, 0)})
    for action in [RIGHT, RIGHT, LEFT]:
        env.step(action)
    assert env.render() == "o@o\n#.T\nstep 3, 1 of 2 targets visited\n"


def tile(image: np.ndarray, level: cpp_rl_gym.Level, cell: tuple[int, int]) -> np.ndarray:
    """The pixels of a cell, ``[size, size, 3]``."""
    size = 72
    assert image.shape == (level.height * size + 36, level.width * size + 36, 3)
    row, column = (18 + size * index for index in cell)
    return image[row : row + size, column : column + size]


def test_a_picture_shows_what_is_where() -> None:
    env = make("..T.\n#..T", render_mode="rgb_array")
    env.reset(options={"start": (0, 0)})
    for action in [RIGHT, RIGHT, DOWN]:
        env.step(action)
    image = env.render()
    assert image.dtype == np.uint8
    shown = {cell: {tuple(pixel) for pixel in tile(image, env.level, cell).reshape(-1, 3).tolist()} for cell in CELLS}
    for cell in CELLS:
        assert (AGENT in shown[cell]) == (cell == (1, 2))
        assert (WALL in shown[cell]) == (cell == (1, 0))
        assert (TARGET in shown[cell]) == (cell == (1, 3))
        assert ({REACHED, REACHED_TILE} <= shown[cell]) == (cell == (0, 2))
        assert (VISITED in shown[cell]) == (cell in [(0, 0), (0, 1), (1, 2)])
    # The trail leads from cell to cell and nowhere else.
    edge = {cell: tile(image, env.level, cell)[36, -1].tolist() for cell in CELLS}
    assert [cell for cell in CELLS if edge[cell] != edge[1, 0]] == [(0, 0), (0, 1)]


CELLS = [(row, column) for row in range(2) for column in range(4)]


@pytest.mark.parametrize(("height", "width"), [(1, 2), (3, 40), (128, 128), (1, 16384)])
def test_maps_of_every_size_have_a_picture(height: int, width: int) -> None:
    level = cpp_rl_gym.as_level("\n".join(["T" + "." * (width - 1)] * height))
    image = picture(level, [(0, 1)])
    assert image.shape[0] >= 8 * height and image.shape[1] >= 8 * width
    assert max(image.shape) <= 16384 * 8 + 4


def test_vector_environments_render_each_copy() -> None:
    envs = make_vec(2, levels=[0, 1], render_mode="rgb_array")
    envs.reset(seed=0)
    first, second = envs.render()
    assert first.shape == second.shape == (612, 612, 3)
    assert (first != second).any()
    envs = make_vec(2, level="..T", render_mode="ansi")
    envs.reset(options={"start": (0, 1)})
    assert envs.render() == (".@T\nstep 0, 0 of 1 targets visited\n",) * 2


@pytest.mark.parametrize("vector", [False, True])
def test_rendering_without_a_mode_is_warned_of(vector: bool) -> None:
    env = make_vec(1) if vector else make()
    with pytest.warns(UserWarning, match="render_mode="):
        assert env.render() is None


def test_a_window_follows_the_episode() -> None:
    pygame = pytest.importorskip("pygame", reason="needs pygame")
    env = make(render_mode="human")
    env.metadata = {**env.metadata, "render_fps": 1000}
    env.reset(options={"start": (0, 0)})
    env.step(RIGHT)
    shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
    np.testing.assert_array_equal(shown, picture(env.level, [(0, 0), (0, 1)]))
    env.close()
    assert pygame.display.get_surface() is None
    env.close()


def test_without_pygame_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(DependencyNotInstalled, match="pip install pygame-ce"):
        make(render_mode="human").reset()
