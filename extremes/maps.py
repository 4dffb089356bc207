# SPDX-License-Identifier: Apache-2.0
"""Maps of what is accurate, only stable, or refused, with the analytic limits drawn in."""
from dataclasses import replace
import math

from cases import any_tuning, damped, ROBOTS
from judge import apart, unsound
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch
import numpy as np

from ballbot_ros.control import lowest_stable_rate
from ballbot_ros.errors import BallbotError
from ballbot_ros.figures.canvas import drawing, INK, save
from ballbot_ros.physics import Actuation, Model, simulate, Solver, State, Terrain
from ballbot_ros.physics.model.actuation import Actuator, position_torque, TORQUE

ACCURATE, STABLE, REFUSED = range(3)
COLOURS = ('#5BB5A2', '#F2D98B', '#C9685B')  # distinct in grey: middle, light, dark
LABELS = ('accurate: within a thousandth of the radius', 'stable: energy residual up to 5 %',
          'refused: SimulationError')
SIZE = 54
METHODS = {'rk4': (2.83, 2.79), 'semi_implicit': (2.0, 2.0)}  # limits of h w and of h a
TITLES = {'rk4': 'rk4, four evaluations a step',
          'semi_implicit': 'semi_implicit, one a step'}
DURATION = 0.5


def graded(model, start, exact, step):
    """Return whether a run with a step is accurate, stable, or refused."""
    every = max(1, round(0.02 / step))
    shown = every * step
    try:
        run = simulate(model, start, Actuation(), int(DURATION / shown) * shown, shown)
    except BallbotError:
        return REFUSED
    if unsound(run)[0]:
        return REFUSED
    truth = {name: np.interp(run['time'], exact['time'], exact[name]) for name in 'xy'}
    truth['time'] = run['time']
    radius = model.robot.ball_radius
    return ACCURATE if apart(run, Samples(truth), DURATION) <= 1e-3 * radius else STABLE


class Samples(dict):
    """Columns with their number of samples."""

    def __len__(self):
        """Return the number of samples."""
        return len(self['time'])


def step_map(values, steps, robot_of, start_of):
    """Return the grades of each method, a row per step and a column per value."""
    grades = {method: np.empty((len(steps), len(values))) for method in METHODS}
    for column, value in enumerate(values):
        model = Model(robot_of(value), Terrain.flat(), solver=Solver('adaptive'))
        start = start_of(model)
        exact = simulate(model, start, Actuation(), DURATION, 1e-4, accuracy=1e-6)
        for method in METHODS:
            for row, step in enumerate(steps):
                fixed = replace(model, solver=Solver(method, float(step)))
                grades[method][row, column] = graded(fixed, start, exact, float(step))
    return grades


def paint(axes, x, y, grades):
    """Colour a map whose axes are decades."""
    axes.pcolormesh(x, y, grades, cmap=ListedColormap(COLOURS), vmin=-0.5, vmax=2.5,
                    shading='nearest', rasterized=True)
    axes.set_xscale('log')
    axes.set_yscale('log')
    axes.set_xlim(x[0], x[-1])
    axes.set_ylim(y[0], y[-1])


def line(axes, x, y, text, at, below=False):
    """Draw a limit and write along it what it is."""
    axes.plot(x, y, color=INK, linewidth=1.6)
    low, high = (np.log10(limit) for limit in (axes.get_xlim(), axes.get_ylim()))
    box = axes.get_window_extent()
    place = int(at * len(x))
    slope = (np.log10(y[-1] / y[0]) / np.diff(high)[0] * box.height) / (
        np.log10(x[-1] / x[0]) / np.diff(low)[0] * box.width)
    axes.annotate(
        text, (x[place], y[place]), (0, -4 if below else 4), textcoords='offset points',
        rotation=math.degrees(math.atan(slope)), rotation_mode='anchor', ha='center',
        va='top' if below else 'bottom', color=INK, fontsize=8.5)


def finish(figure, path, labels=LABELS):
    """Add the legend below and write the file."""
    figure.legend(handles=[Patch(color=colour, label=label)
                           for colour, label in zip(COLOURS, labels)],
                  loc='lower center', ncol=3, frameon=False, fontsize=8, columnspacing=1.5)
    save(figure, path)


def step_figure(path, values, name, robot_of, start_of, limits):
    """Draw step against `values`, a panel per method."""
    steps = np.logspace(-5, -1, SIZE)
    grades = step_map(values, steps, robot_of, start_of)
    with drawing(7.4, 3.9) as figure:
        figure.subplots_adjust(left=0.085, right=0.985, top=0.92, bottom=0.24, wspace=0.12)
        for index, method in enumerate(METHODS):
            axes = figure.add_subplot(1, 2, 1 + index)
            paint(axes, values, steps, grades[method])
            for limit, text, at, below in limits(method):
                line(axes, values, np.array([limit(value) for value in values]), text, at, below)
            axes.set_title(TITLES[method])
            axes.set_xlabel(name)
            axes.axhline(Solver().step, color=INK, linewidth=0.8, linestyle=(0, (4, 3)))
            if index == 0:
                axes.set_ylabel('step [s]')
                axes.annotate('default step', (values[-1], Solver().step), (-4, 3),
                              textcoords='offset points', ha='right', fontsize=8, color=INK)
            else:
                axes.set_yticklabels([])
        finish(figure, path)


def stiffness_figure(path):
    """Step against stiffness: a ball drops, bounces and rolls, damping ratio kept."""
    robot = ROBOTS['shellball']
    ratio = robot.damping_ratio

    def limits(method):
        number = METHODS[method][0]
        yield (lambda k: number * math.sqrt(robot.total_mass / k),
               f'step = {number:g} $\\sqrt{{M/k}}$', 0.5, False)
    step_figure(
        path, np.logspace(3, 8, SIZE), 'contact stiffness k [N/m]',
        lambda k: damped(replace(robot, contact_stiffness=float(k)), ratio),
        lambda model: State(y=model.robot.ball_radius + 0.02, velocity_x=0.5), limits)


def slip_figure(path):
    """Step against slip threshold: a ball slides, then rolls."""
    robot = ROBOTS['shellball']
    rate = robot.surface_friction * robot.gravity * (
        1.0 + robot.total_mass * robot.ball_radius**2 / robot.ball_inertia)

    def limits(method):
        number = METHODS[method][1]
        yield (lambda threshold: number * threshold / rate,
               f'step = {number:g} $v_s$ / ($\\mu$ g (1 + M R²/J₁))', 0.36, True)
        contact = METHODS[method][0] * math.sqrt(robot.total_mass / robot.contact_stiffness)
        yield lambda threshold: contact, 'limit of the contact spring', 0.72, False
    step_figure(
        path, np.logspace(-5, 0, SIZE), 'slip threshold $v_s$ [m/s]',
        lambda threshold: replace(robot, slip_threshold=float(threshold)),
        lambda model: model.at_rest(0.0, 1.0)._replace(ball_rate=0.0), limits)


def loop_grade(robot, tuning, rate):
    """Return whether a small push dies out (0), grows (1), or ends the run (2)."""
    model = Model(robot, Terrain.flat(), solver=Solver(
        'adaptive', min(0.1, 1.0 / rate), 1e-9, work_budget=20_000))
    state = model.at_rest(0.0)._replace(pendulum_rate=0.01)
    rates = []
    try:
        for _ in range(int(min(max(rate, 60), 400))):
            torque = position_torque(state.pendulum_angle, state.pendulum_rate, 0.0,
                                     tuning.position_kp, tuning.position_kd,
                                     robot.largest_gravity_torque)
            state = model.advance(state, Actuator(TORQUE, torque), 1)
            rates.append(abs(state.pendulum_rate))
    except BallbotError:
        return REFUSED
    return STABLE if max(rates[-10:]) > 0.01 else ACCURATE


def loop_figure(path):
    """Control rate against gain: where law (11) holds the pendulum, and where it is said to."""
    robot = ROBOTS['gimball']
    gains, rates = np.logspace(-1, 3, SIZE), np.logspace(1, 5, SIZE)
    tunings = [any_tuning(40.0 * gain, 10.0 * gain) for gain in gains]
    grades = np.array([[loop_grade(robot, tuning, float(rate)) for tuning in tunings]
                       for rate in rates])
    with drawing(5.6, 4.2) as figure:
        figure.subplots_adjust(left=0.12, right=0.97, top=0.93, bottom=0.2)
        axes = figure.add_subplot()
        paint(axes, gains, rates, grades)
        lowest = np.array([lowest_stable_rate(robot, tuning, 'hold', 0, [0.0])
                           for tuning in tunings])
        reached = np.isfinite(lowest)
        line(axes, gains[reached], lowest[reached],
             'lowest_stable_rate, for a ball that never slips', 0.5, True)
        axes.set_xlabel('gains of law (11), times the published ones')
        axes.set_ylabel('control rate [Hz]')
        axes.set_title('GimBall, pendulum held down, torque held between samples')
        finish(figure, path,
               ('the push dies out', 'it grows', 'it grows until the run is refused'))


def draw_all(folder):
    """Write the three pictures into a folder."""
    for name, draw in (('stiffness', stiffness_figure), ('slip', slip_figure),
                       ('loop', loop_figure)):
        path = folder / f'extremes_{name}.png'
        draw(path)
        print(path)
