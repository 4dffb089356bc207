# SPDX-License-Identifier: Apache-2.0
"""Animation of a run: GIF, or MP4 if ffmpeg is installed."""
from contextlib import suppress
from importlib.util import find_spec
import math
from pathlib import Path
import shutil
import subprocess
from typing import Any, Iterator, NamedTuple, Optional

from matplotlib.figure import Figure
from matplotlib.patches import FancyArrow
from matplotlib.ticker import MaxNLocator
import numpy as np
from numpy.typing import NDArray

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.figures import canvas
from ballbot_ros.figures.drawing import draw_ball, draw_ground, FORCE, ground_line, legend, PATH
from ballbot_ros.figures.frames import ROW
from ballbot_ros.figures.panels import plottable
from ballbot_ros.physics.mechanics.contact import (
    contact_force, contact_table, EDGE, find_contacts, KIND, NORMAL_X, NORMAL_Y)
from ballbot_ros.physics.model.state import force_components, SIZE, X, Y
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.trajectory import Trajectory
from ballbot_ros.results.files import PathLike, replacing
from ballbot_ros.studies.progress import ignore, Progress

Picture = NDArray[np.uint8]
KINDS = ('.gif', '.mp4')

# Frames per second; the time unit of a GIF is 0.01 s, and a frame lasts 4 of them.
FRAME_RATE = 25.0

# Longest animation that a browser shows smoothly, and that fits into memory [s].
LONGEST_GIF = 60.0

_HOLD = 1.0  # duration of the last frame before a GIF repeats [s]
_WIDTH, _DOTS = 7.6, 100  # [in], [1/in]
_LEFT, _RIGHT, _TOP, _BOTTOM = 0.62, 0.14, 0.66, 0.44  # [in]
_BESIDE, _BELOW, _TALLEST = 1.3, 0.45, 7.0  # margins, and largest height [ball radii]
_COLOURS, _EXACT = 128, 24  # of a GIF, and the number of exact colours among them

# Length of a force arrow for the weight of the robot, and maximum length [ball radii].
_ARROW, _LONGEST_ARROW = 0.6, 2.2


# Samples per picture: an impact lasts a few milliseconds.
_SAMPLES = 40

# Contacts whose normals differ by less are one contact that has moved [rad].
_SAME = 0.35


class ForceArrow(NamedTuple):
    """The mean force at one contact [N], and its position (x, y) on the shell [m]."""

    x: float
    y: float
    force_x: float
    force_y: float


def mean_forces(run: Trajectory, frames: NDArray[np.int64]) -> list[tuple[ForceArrow, ...]]:
    """
    Return the mean contact forces since the previous frame, for each frame (a sample index).

    Forces at single times would miss most impacts, or show their peaks by chance.
    """
    table = contact_table(len(run.model.profile))
    numbers = frames.tolist()
    spans = [np.unique(np.linspace(min(before + 1, last), last, _SAMPLES).astype(int))
             for before, last in zip([numbers[0] - 1, *numbers], numbers)]
    return [_mean(run, samples, table) for samples in spans]


def _mean(run: Trajectory, samples: NDArray[np.int64],
          table: Array) -> tuple[ForceArrow, ...]:
    """Return the mean contact forces over some samples, with the ball at the last of them."""
    model = run.model
    found: list[list[float]] = []  # edge or not, weighted normal, force
    for state in run.rows[samples, 1:1 + SIZE]:
        count = find_contacts(state[X], state[Y], model.parameters.radius, model.profile, table)
        for row in range(count):
            normal, friction, _ = contact_force(state, model.parameters, table, row)
            edge = float(table[row, KIND] == EDGE)
            normal_x, normal_y = float(table[row, NORMAL_X]), float(table[row, NORMAL_Y])
            # The negative force of a corner between two contacts belongs to its neighbours.
            for known in found:
                size = math.hypot(known[1], known[2]) or 1.0
                if known[0] == edge and (known[1] * normal_x + known[2] * normal_y
                                         > size * math.cos(_SAME)):
                    break
            else:
                known = [edge, 0.0, 0.0, 0.0, 0.0]
                found.append(known)
            weight = max(normal, 1e-9)
            known[1] += weight * normal_x
            known[2] += weight * normal_y
            along, up = force_components(normal, friction, normal_x, normal_y)
            known[3] += along
            known[4] += up
    x, y, radius = run['x'][samples[-1]], run['y'][samples[-1]], model.parameters.radius
    forces = []
    for _, along_x, along_y, force_x, force_y in found:
        size = math.hypot(along_x, along_y)
        forces.append(ForceArrow(
            float(x - radius * along_x / size), float(y - radius * along_y / size),
            force_x / len(samples), force_y / len(samples)))
    return tuple(forces)


class _View(NamedTuple):
    """Size of the view [m], and whether it follows the ball."""

    width: float
    height: float
    follows_x: bool
    follows_y: bool


def check_animation(path: PathLike, duration: float, playback: float = 1.0) -> None:
    """
    Refuse an animation that cannot be written, before its run is simulated.

    The path must end in .gif or .mp4; `duration` is that of the run [s], and `playback` the
    simulated seconds per second of the animation.  Raises `ConfigurationError` with the remedy.
    """
    kind = Path(path).suffix.lower()
    if kind not in KINDS:
        raise ConfigurationError(
            f'{path}: an animation must end in {" or ".join(KINDS)}, got {kind!r}',
            'not_a_choice', 'path')
    if not 0.01 <= playback <= 1000.0:
        raise ConfigurationError(
            f'playback must be at least 0.01 and at most 1000, got {playback:g}',
            'out_of_range', 'playback')
    if kind == '.mp4' and ffmpeg() is None:
        raise ConfigurationError(
            f'{path}: MP4 needs ffmpeg, which is not installed: "sudo apt-get install ffmpeg" or '
            '"pip install imageio-ffmpeg", '
            'or choose a file ending in .gif', 'not_installed', 'ffmpeg')
    if kind == '.gif' and duration / playback > LONGEST_GIF:
        raise ConfigurationError(
            f'{path}: a GIF of {duration / playback:g} s exceeds the maximum of {LONGEST_GIF:g} '
            f's: choose a playback of {math.ceil(duration / LONGEST_GIF)} or more, or .mp4',
            'out_of_range', 'playback')


def ffmpeg() -> Optional[str]:
    """Return the path of ffmpeg, from PATH or from the package imageio-ffmpeg; None if absent."""
    found = shutil.which('ffmpeg')
    if found is None and find_spec('imageio_ffmpeg') is not None:
        from imageio_ffmpeg import get_ffmpeg_exe
        with suppress(RuntimeError):  # the package has no executable for this platform
            found = get_ffmpeg_exe()
    return found


def animate(trajectory: Trajectory, path: PathLike, title: str = '', playback: float = 1.0,
            progress: Progress = ignore) -> None:
    """
    Write a run as an animation, atomically; the title may be the name of the scene.

    See `check_animation` for the arguments and for the error, which is also raised here.
    """
    run = plottable(trajectory)
    check_animation(path, float(run['time'][-1] - run['time'][0]), playback)
    frames = frame_samples(run['time'], playback)
    pictures = _pictures(run, frames, title, playback, progress)
    with replacing(path) as stream:
        if Path(path).suffix.lower() == '.gif':
            some = frames[np.linspace(0, len(frames) - 1, 6).astype(int)]
            _write_gif(pictures, np.vstack(list(_pictures(run, some, title, playback, ignore))),
                       stream)
        else:
            _write_mp4(pictures, stream.name)


def frame_samples(time: NDArray[np.float64], playback: float) -> NDArray[np.int64]:
    """Return the samples nearest to the times of the frames [s], first and last included."""
    if len(time) == 1:
        return np.zeros(1, dtype=np.int64)
    span = float(time[-1] - time[0])
    count = max(1, round(span / playback * FRAME_RATE))
    times = time[0] + span * np.arange(count + 1) / count
    after = np.searchsorted(time, times).clip(1, len(time) - 1)
    nearest: NDArray[np.int64] = after - (times - time[after - 1] < time[after] - times)
    return nearest


def _pictures(run: Trajectory, frames: NDArray[np.int64], title: str, playback: float,
              progress: Progress) -> Iterator[Picture]:
    """Yield the pictures in order, each (height, width, 3)."""
    forces = mean_forces(run, frames)
    view = _view(run)
    scale = (_WIDTH - _LEFT - _RIGHT) / view.width  # [in/m]
    height = _TOP + _BOTTOM + scale * view.height
    # A video requires even numbers of pixels.
    height = 2.0 * round(0.5 * height * _DOTS) / _DOTS
    with canvas.drawing(_WIDTH, height) as figure:
        figure.set_dpi(_DOTS)
        axes = figure.add_axes((_LEFT / _WIDTH, _BOTTOM / height,
                                1.0 - (_LEFT + _RIGHT) / _WIDTH,
                                1.0 - (_TOP + _BOTTOM) / height))
        words = _draw_static(figure, axes, run, title, playback)
        path, = axes.plot([], [], color=PATH, lw=1.2, zorder=2.8)
        static = set(axes.get_children())
        for number, index in enumerate(frames.tolist()):
            _look_at(axes, run, view, index)
            path.set_data(run['x'][:index + 1], run['y'][:index + 1])
            draw_ball(axes, run.model.robot, run['x'][index], run['y'][index],
                      run['ball_angle'][index], run['pendulum_angle'][index], 1.0)
            for force in forces[number]:
                _draw_force(axes, run, force)
            words.set_text(_words(run, index))
            figure.canvas.draw()
            picture: Any = figure.canvas
            yield np.asarray(picture.buffer_rgba())[..., :3].copy()
            for artist in set(axes.get_children()) - static:
                artist.remove()
            progress((number + 1) / len(frames))


def _view(run: Trajectory) -> _View:
    """Return the view: the entire run, unless the ball would be too small."""
    radius = run.model.robot.ball_radius
    span = float(np.ptp(run['x'])) + 2.0 * _BESIDE * radius
    width = min(max(span, 6.0 * radius), ROW * radius)
    rise = float(np.ptp(run['y'])) + (2.15 + _BELOW) * radius
    return _View(width, min(rise, _TALLEST * radius), span > width, rise > _TALLEST * radius)


def _draw_static(figure: Figure, axes: Any, run: Trajectory, title: str, playback: float) -> Any:
    """Draw the static part, and return the text artist for the values of a frame."""
    width, height = figure.get_size_inches()
    robot = run.model.robot
    far = ROW * robot.ball_radius
    left, right = float(run['x'].min()) - far, float(run['x'].max()) + far
    lowest = float(ground_line(run.model.terrain, left, right)[:, 1].min())
    draw_ground(axes, run.model.terrain, left, right, lowest - far)
    axes.xaxis.set_major_locator(MaxNLocator(9, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(3, steps=[1, 2, 5, 10]))
    axes.set_xlabel('x [m]', labelpad=1.0)
    axes.set_ylabel('y [m]')
    pace = '' if playback == 1.0 else f'{playback:g} times real time'
    figure.text(_LEFT / width, 1.0 - 0.25 / height, ', '.join(
        part for part in (title, robot.name, pace) if part), fontsize=11, weight='bold')
    figure.text(_LEFT / width, 1.0 - 0.45 / height, legend(robot.has_pendulum, force=True),
                fontsize=7.5, color=canvas.GREY)
    return figure.text(1.0 - _RIGHT / width, 1.0 - 0.25 / height, '', fontsize=10, ha='right')


def _look_at(axes: Any, run: Trajectory, view: _View, index: int) -> None:
    radius = run.model.robot.ball_radius
    x, y = run['x'], run['y']
    middle = x[index] if view.follows_x else 0.5 * (x.min() + x.max())
    axes.set_xlim(middle - 0.5 * view.width, middle + 0.5 * view.width)
    below = (y[index] - 0.4 * view.height if view.follows_y
             else float(y.min()) - (1.0 + _BELOW) * radius)
    axes.set_ylim(below, below + view.height)


def _draw_force(axes: Any, run: Trajectory, force: ForceArrow) -> None:
    robot = run.model.robot
    size = math.hypot(force.force_x, force.force_y)
    length = min(_ARROW * size / robot.weight, _LONGEST_ARROW) * robot.ball_radius
    if length < 0.05 * robot.ball_radius:
        return
    along_x, along_y = length * force.force_x / size, length * force.force_y / size
    axes.add_patch(FancyArrow(
        force.x, force.y, along_x, along_y, width=0.035 * robot.ball_radius,
        head_width=0.14 * robot.ball_radius, head_length=min(0.2 * robot.ball_radius, length),
        length_includes_head=True, facecolor=FORCE, lw=0, zorder=6))


def _words(run: Trajectory, index: int) -> str:
    speed = math.hypot(run['velocity_x'][index], run['velocity_y'][index])
    words = f'{run["time"][index]:.2f} s    {speed:.2f} m/s'
    if run.model.robot.has_pendulum:
        words += f'    pendulum {round(math.degrees(run["pendulum_angle"][index]))} deg'
    return words


def _write_gif(pictures: Iterator[Picture], some: Picture, stream: Any) -> None:
    """Write pictures with a common palette, so that static parts are not stored repeatedly."""
    from PIL import Image
    palette = _palette(some)
    # Palette index by colour. Image.quantize selects similar colours only, even for white.
    known = np.full(1 << 24, -1, dtype=np.int16)
    frames = []
    for picture in pictures:
        codes = _codes(picture)
        unknown = np.unique(codes[known[codes] < 0])
        for part in np.array_split(unknown, len(unknown) // 1000 + 1):
            distance = ((_colours(part)[:, None] - palette[None])**2).sum(axis=-1)
            known[part] = distance.argmin(axis=-1)
        frame = Image.fromarray(known[codes].astype(np.uint8), 'P')
        frame.putpalette(palette.astype(np.uint8).tobytes())
        frames.append(frame)
    period = round(1e3 / FRAME_RATE)
    frames[0].save(stream, format='GIF', save_all=True, append_images=frames[1:], loop=0,
                   duration=[period] * (len(frames) - 1) + [period + round(1e3 * _HOLD)],
                   optimize=False, disposal=1)


def _codes(picture: Picture) -> NDArray[np.int32]:
    """Return the colour of each pixel as a number."""
    return picture.astype(np.int32) @ np.array([1 << 16, 1 << 8, 1], dtype=np.int32)


def _colours(codes: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return red, green and blue for each number of `_codes`."""
    return np.stack([codes >> 16, codes >> 8 & 255, codes & 255], axis=-1)


def _palette(some: Picture) -> NDArray[np.int32]:
    """Return the colours of a GIF, (n, 3): the most frequent exactly, the others averaged."""
    from PIL import Image
    codes, counts = np.unique(_codes(some), return_counts=True)  # on rows, this takes seconds
    colours = _colours(codes).astype(np.uint8)
    exact = colours[np.argsort(-counts, kind='stable')[:_EXACT]]
    mixed = Image.fromarray(colours[None]).quantize(_COLOURS - _EXACT).getpalette() or []
    return np.vstack([exact, np.reshape(mixed, (-1, 3))[:_COLOURS - _EXACT]]).astype(np.int32)


def _write_mp4(pictures: Iterator[Picture], path: str) -> None:
    """Pass pictures to ffmpeg; a separate session shields it from Ctrl-C."""
    first = next(pictures)
    height, width, _ = first.shape
    command = [ffmpeg() or 'ffmpeg', '-loglevel', 'error', '-y', '-f', 'rawvideo',
               '-pix_fmt', 'rgb24', '-s', f'{width}x{height}', '-r', f'{FRAME_RATE:g}', '-i', '-',
               '-an', '-pix_fmt', 'yuv420p', '-movflags', '+faststart', '-f', 'mp4', path]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE,
                          start_new_session=True) as process:
        assert process.stdin is not None and process.stderr is not None
        try:
            process.stdin.write(first.tobytes())
            for picture in pictures:
                process.stdin.write(picture.tobytes())
            process.stdin.close()
        except BrokenPipeError:
            pass  # its error output has the reason
        except BaseException:
            process.kill()
            raise
        errors = process.stderr.read().decode(errors='replace').strip().splitlines()
    if process.returncode:
        raise ConfigurationError(
            f'ffmpeg failed: {errors[-1] if errors else process.returncode}; a file ending in '
            '.gif does not need it', 'unavailable', 'ffmpeg')
