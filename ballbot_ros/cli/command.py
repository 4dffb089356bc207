# SPDX-License-Identifier: Apache-2.0
"""
Find the verb on the command line and hand over to its module.

Each verb is a line of `VERBS` and a module with ``add_arguments(parser)`` and
``run(arguments) -> int``.  Only the module of the verb that was asked for is imported, and
it imports what is heavy inside ``run``: help and errors come at once.
"""
import argparse
from contextlib import contextmanager
from difflib import get_close_matches
from importlib import import_module
import logging
import os
import signal
import sys
from threading import current_thread, Event, main_thread
from typing import Iterator, NoReturn, Optional, Sequence

from ballbot_ros import __version__
from ballbot_ros.errors import BallbotError, ConfigurationError

# Verb -> its module and what it does.
VERBS = {
    'demo': ('ballbot_ros.cli.demo', 'show all ROS nodes at work: the robot meets a step that '
             'it can cross and one that it cannot'),
    'run': ('ballbot_ros.cli.run', 'run a node as ros2 run does, or an experiment from a file'),
    'drive': ('ballbot_ros.cli.drive', 'drive the robot from the keyboard or with a gamepad'),
    'topics': ('ballbot_ros.cli.topics', 'list the topics of the running graph'),
    'echo': ('ballbot_ros.cli.echo', 'print the messages of a topic'),
    'hz': ('ballbot_ros.cli.hz', 'print how often messages of a topic arrive'),
    'record': ('ballbot_ros.cli.record', 'record topics into an MCAP bag'),
    'release-e-stop': ('ballbot_ros.cli.release_e_stop', 'release the e-stop, so that the '
                       'motor may have power again, if the bridge allows it'),
    'engage-e-stop': ('ballbot_ros.cli.engage_e_stop', 'engage the e-stop, which takes '
                      'the power off the motor'),
    'simulate': ('ballbot_ros.cli.simulate', 'run a scene and keep numbers and figures'),
    'view': ('ballbot_ros.cli.view', 'look at a scene in the browser, and drive it'),
    'max-step-height': ('ballbot_ros.cli.max_step_height',
                        'find the highest step that a robot gets over'),
    'fit-curve': ('ballbot_ros.cli.fit_curve', 'make the height curve of a robot, for '
                  'obstacle_decision'),
    'evaluate-decision': ('ballbot_ros.cli.evaluate_decision', 'try the obstacle decision in '
                          'closed loop, in thousands of random approaches'),
    'sweep': ('ballbot_ros.cli.sweep', 'try crossings while any numbers vary, on all cores '
              'or a cluster'),
    'identify': ('ballbot_ros.cli.identify', 'estimate numbers of a robot from a recorded run'),
    'compare-models': ('ballbot_ros.cli.compare_models', 'compare simpler models of the '
                       'highest step with the simulation'),
    'calibrate-motor': ('ballbot_ros.cli.calibrate_motor', 'find direction, encoder scale and '
                        'torque of a real motor, gently, and write a hardware file'),
    'doctor': ('ballbot_ros.cli.doctor', 'find out why a motor controller does not answer'),
    'emulate-motor': ('ballbot_ros.cli.emulate_motor', 'emulate a motor controller, with the '
                      'ball behind it, on a serial device'),
    'replay': ('ballbot_ros.cli.replay', 'run a recorded bag again beside the model, or show what '
               'happened before a fault, from the file of a black box'),
    'on-timeout': ('ballbot_ros.cli.on_timeout', 'show what the ball does on a slope when its '
                   'commands stop'),
    'figures': ('ballbot_ros.cli.figures', "draw the paper's figures, re-simulated, and some "
                'more'),
    'scenes': ('ballbot_ros.cli.scenes', 'list the scenes that come with the package'),
    'test-bench': ('ballbot_ros.cli.test_bench', 'roll a virtual robot into steps as the '
                   "paper's tests did"),
    'outcomes': ('ballbot_ros.cli.outcomes', 'list, export or reset the attempts at steps that a '
                 'robot has made, or show what they teach'),
    'new': ('ballbot_ros.cli.new', 'write a commented template of a file: robot, scene, hardware, '
            'experiment, gains or margins'),
    'robots': ('ballbot_ros.cli.robots', 'list the robots, or the numbers of one of them'),
}

# Exit codes: of the shell for what a signal ended (128 + its number), argparse's for misuse.
DONE, FAILED, MISUSED, INTERRUPTED, PIPE_CLOSED = 0, 1, 2, 130, 141
CUT_SHORT = 'interrupted; files written before are complete, others were not begun'


class Parser(argparse.ArgumentParser):
    """A parser that raises instead of printing its usage and ending the program."""

    words: Sequence[str] = ()  # all that was given
    asked: Optional['Parser'] = None  # that of the verb

    def error(self, message: str) -> NoReturn:
        """Raise `ConfigurationError`, with the nearest option of a misspelt one."""
        known = (self.asked or self)._option_string_actions
        words = [word.split('=')[0].strip("':,") for word in message.split()]
        words += [word.split('=')[0] for word in self.words if word[:2] == '--']
        # What follows --ros-args is not ours.
        words = words[:words.index('--ros-args')] if '--ros-args' in words else words
        hints = [f'{word}: did you mean {near[0]}?' for word in dict.fromkeys(words)
                 if word.startswith('--') and word not in known
                 and (near := get_close_matches(word, known, n=1))]
        raise ConfigurationError('; '.join(
            [message, *hints, f'see {(self.asked or self).prog} --help']))


def main(argv: Optional[Sequence[str]] = None) -> int:
    """
    Run the command ``ballbot``.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments without the name of the program; those of the process by default.

    Returns
    -------
    int
        Exit code: 0, 1 for a run that could not go on, 2 for a mistake in the arguments or
        a file, 130 after Ctrl-C.

    """
    with _interruption() as pressed:
        try:
            return _guarded(argv)
        except Exception:
            # An extension that was compiling or calling back has made its own of Ctrl-C.
            if not pressed.is_set():
                raise
            print_error(CUT_SHORT)
            return INTERRUPTED


def _guarded(argv: Optional[Sequence[str]]) -> int:
    """Run, and turn each expected way to end into a line and an exit code."""
    try:
        try:
            code = _run(list(sys.argv[1:] if argv is None else argv))
        finally:
            sys.stdout.flush()
        return code
    except BrokenPipeError:
        # Whoever read has gone; what is still buffered must not fail again at the exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return PIPE_CLOSED
    except KeyboardInterrupt:
        print_error(CUT_SHORT)
        return INTERRUPTED
    except BallbotError as error:
        print_error(str(error))
        return MISUSED
    except MemoryError:
        print_error('not enough memory; ask for a shorter duration or a larger output_step')
        return FAILED


@contextmanager
def _interruption() -> Iterator[Event]:
    """Give an event that Ctrl-C sets, also where its exception gets lost."""
    pressed = Event()

    def note(*_: object) -> None:
        pressed.set()
        raise KeyboardInterrupt

    ours = (current_thread() is main_thread()
            and signal.getsignal(signal.SIGINT) is signal.default_int_handler)
    if ours:
        signal.signal(signal.SIGINT, note)
    try:
        yield pressed
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def print_error(message: str) -> None:
    """Print an error as one line on standard error."""
    print(f'ballbot: error: {" ".join(message.split())}', file=sys.stderr)


def _run(words: list[str]) -> int:
    """Parse the words and run their verb."""
    if words[:1] == ['help']:  # "ballbot help simulate", as other programs have it
        words = [*words[1:2], '--help']
    verb = next((word for word in words if not word.startswith('-')), None)
    if verb is not None and verb not in VERBS:
        from ballbot_ros.config.fields import suggestion
        raise ConfigurationError(
            f'{verb!r} is not a command{suggestion(verb, VERBS)}; see ballbot --help')
    parser = Parser(prog='ballbot', allow_abbrev=False, description=(
        'Simulator, controller and obstacle decision for a pendulum-driven ball robot.'))
    parser.add_argument('--version', action='version', version=f'ballbot {__version__}')
    choices = parser.add_subparsers(dest='verb', metavar='command', parser_class=Parser)
    for name, (module, help_text) in VERBS.items():
        sub = choices.add_parser(name, help=help_text, allow_abbrev=False,
                                 description=f'{help_text[0].upper()}{help_text[1:]}.')
        if name == verb:
            import_module(module).add_arguments(sub)
            parser.asked = sub
            parser.words = sub.words = words
    try:
        arguments = parser.parse_args(words)
    except SystemExit as ending:  # --help and --version
        return ending.code if isinstance(ending.code, int) else FAILED
    if arguments.verb is None:
        parser.print_help()
        return MISUSED
    with _warnings_off(getattr(arguments, 'quiet', False)):
        code: int = import_module(VERBS[arguments.verb][0]).run(arguments)
    return code


@contextmanager
def _warnings_off(quiet: bool) -> Iterator[None]:
    """Keep the log of the package, where kernels say that they compile, to errors if asked to."""
    log = logging.getLogger('ballbot_ros')
    level = log.level
    if quiet:
        log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(level)
