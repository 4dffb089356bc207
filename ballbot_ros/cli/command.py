# SPDX-License-Identifier: Apache-2.0
"""
Find the verb on the command line and call its module.

Each verb is an entry of `VERBS` and a module with ``add_arguments(parser)`` and
``run(arguments) -> int``, or a `Verb` in a module with several verbs.  Only the module of the
given verb is imported, and it imports heavy modules inside ``run``, so that help and errors
appear immediately.
"""
from contextlib import contextmanager, nullcontext
import errno
from importlib import import_module
import logging
import os
import re
import signal
import sys
from threading import current_thread, main_thread, Timer
from typing import Any, Collection, Iterator, Optional, Sequence
import warnings

from ballbot_ros import __version__
from ballbot_ros.cli.output import compilation_shown, empty_folders_removed
from ballbot_ros.cli.verb import (
    DONE, FAILED, INTERRUPTED, MISUSED, note, Parser, PIPE_CLOSED, print_error)
from ballbot_ros.config.fields import suggestion
from ballbot_ros.errors import (
    BallbotError, ConfigurationError, PlausibilityWarning, SimulationError)
from ballbot_ros.ros.signals import ending_signals


# Verb -> its module (module:name for a `Verb` in it) and its description.
VERBS = {
    'demo': ('demo', 'run all ROS nodes: the robot approaches a step that it can cross and one '
             'that it cannot'),
    'run': ('run', 'run a node as ros2 run does, or an experiment from a file'),
    'drive': ('drive', 'drive the robot from the keyboard or with a gamepad'),
    'topics': ('graph:TOPICS', 'list the topics of the running graph'),
    'echo': ('graph:ECHO', 'print the messages of a topic'),
    'hz': ('graph:HZ', 'print the rate of the messages of a topic'),
    'record': ('graph:RECORD', 'record topics into an MCAP bag'),
    'release-e-stop': ('graph:RELEASE', 'release the e-stop, if the bridge allows it; motor power '
                       'can then be enabled'),
    'engage-e-stop': ('graph:ENGAGE', 'engage the e-stop, which disables motor power'),
    'simulate': ('simulate', 'simulate a scene; write numbers and figures'),
    'view': ('view', 'show a scene, a bag or running nodes in the browser, and drive the robot'),
    'plan-route': ('plan_route', 'plan a route on a floor with steps, with a run-up for each '
                   'crossing'),
    'floor-masks': ('plan_route:MASKS', "write masks of a floor for Nav2's costmap filters"),
    'max-step-height': ('max_step_height', 'compute the maximum step height of a robot'),
    'fit-curve': ('fit_curve', 'fit the height curve of a robot for obstacle_decision'),
    'evaluate-decision': ('evaluate_decision', 'evaluate the obstacle decision in closed loop, '
                          'over thousands of random approaches'),
    'evaluate-navigation': ('evaluate_navigation', 'drive to goals in random houses in closed '
                            'loop; compare with planners without run-up'),
    'sweep': ('sweep', 'compute crossings over any parameters, on all cores or a cluster'),
    'identify': ('identify', 'estimate parameters of a robot from a recorded run'),
    'compare-models': ('compare_models', 'compare simpler models of the maximum step height with '
                       'the simulation'),
    'calibrate-motor': ('calibrate_motor', 'measure direction, encoder scale and torque of a real '
                        'motor at low torque; write a hardware file'),
    'doctor': ('doctor', 'check ports, motor controller and ROS settings, with a remedy for each '
               'problem'),
    'emulate-motor': ('emulate_motor', 'emulate a motor controller and a simulated ball on a '
                      'serial device'),
    'replay': ('replay', 'compare a recorded bag with the model, or show the black box of a '
               'fault'),
    'on-timeout': ('on_timeout', 'show the motion of the ball on a slope when its commands stop'),
    'figures': ('figures', "draw the paper's figures from new simulations, and additional ones"),
    'scenes': ('listing:SCENES', 'list the scenes that come with the package'),
    'test-bench': ('test_bench', "repeat the paper's step tests with a virtual robot"),
    'outcomes': ('outcomes', 'list, export or reset the logged attempts of a robot, or show the '
                 'parameters learned from them'),
    'new': ('new', 'write a commented template of a file: robot, scene, hardware, experiment, '
            'tuning, floor or decision'),
    'robots': ('listing:ROBOTS', 'list the robots, or print the parameters of one'),
}

# Verbs that run until Ctrl-C and then return exit code 0.
UNTIL_CTRL_C = {'drive', 'echo', 'emulate-motor', 'hz', 'view'}
# Delay before a KeyboardInterrupt that C code has ignored is raised again [s].
RAISE_AGAIN = 0.1


def load_verb(name: str) -> Any:
    """Return the module or `Verb` of a name in `VERBS`; either has add_arguments and run."""
    module, _, part = VERBS[name][0].partition(':')
    found = import_module(f'ballbot_ros.cli.{module}')
    return getattr(found, part) if part else found


def parser_of(verbs: Collection[str] = tuple(VERBS)) -> Parser:
    """Return the parser with the options of some verbs, for the documentation of all."""
    parser = Parser(prog='ballbot', allow_abbrev=False, description=(
        'Simulator, controller and obstacle decision for a pendulum-driven ball robot.'))
    parser.add_argument('--version', action='version', version=f'ballbot {__version__}')
    choices = parser.add_subparsers(dest='verb', metavar='command', parser_class=Parser)
    for name, (_, help_text) in VERBS.items():
        sub = choices.add_parser(name, help=help_text, allow_abbrev=False,
                                 description=f'{help_text[0].upper()}{help_text[1:]}.')
        if name in verbs:
            load_verb(name).add_arguments(sub)
            parser.of_verb = sub
    return parser


def main(argv: Optional[Sequence[str]] = None) -> int:
    """
    Run the command ``ballbot`` with the given arguments, by default those of the process.

    Returns the exit code: 0, 1 for a failed run, 2 for an error in the arguments or a file, 130
    after Ctrl-C (0 for a verb that runs until Ctrl-C), 143 or 129 after SIGTERM or SIGHUP, 141 for
    a closed output pipe.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    for name in ('stdout', 'stderr'):
        if getattr(sys, name) is None:  # closed before the start
            setattr(sys, name, open(os.devnull, 'w'))
    with _interruption() as received:
        try:
            try:
                code = _run(words)
            finally:
                sys.stdout.flush()
        except BrokenPipeError:  # the reader has closed the pipe
            _discard_output()
            return PIPE_CLOSED
        except BallbotError as error:
            print_refusal(error)
            return FAILED if isinstance(error, SimulationError) else MISUSED
        except MemoryError:
            print_error('not enough memory; use a shorter duration or a larger output_step')
            return FAILED
        except (KeyboardInterrupt, Exception) as error:
            # An extension that compiles or calls back may raise another error instead.
            if isinstance(error, Exception) and not received:
                if not isinstance(error, OSError) or (
                        error.filename is None and error.errno != errno.ENOSPC):
                    raise
                if error.filename is None:  # standard output, unlike a file, has no name
                    _discard_output()
                print_error(': '.join(filter(None, (error.filename, error.strerror))))
                return FAILED
            if UNTIL_CTRL_C.intersection(words[:1]) and received[-1:] in ([], [signal.SIGINT]):
                return DONE
            known = error.args if isinstance(error, KeyboardInterrupt) else ()
            print_error('; '.join(('interrupted', *known)))
            code = INTERRUPTED
        return 128 + received[-1] if code == INTERRUPTED and received else code


def _discard_output() -> None:
    """Discard buffered text, which cannot be written, so that it does not fail again at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def _interruption() -> Iterator[list[int]]:
    """
    Raise `KeyboardInterrupt` after Ctrl-C and `ending_signals`; handlers of the caller remain.

    Yields the list of received signals, which are known even if the exception is suppressed.
    """
    received: list[int] = []

    def send_again() -> None:  # a flag alone would not interrupt a system call
        signal.pthread_kill(main_thread().ident or 0, received[-1])

    again = Timer(0.0, send_again)

    def interrupt(number: int, _: object) -> None:
        received.append(number)
        raise KeyboardInterrupt

    def reraise(unraisable: Any) -> None:
        nonlocal again
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            hook(unraisable)
        elif not again.is_alive():  # C code has called Python code and ignores its exceptions
            again = Timer(RAISE_AGAIN, send_again)
            again.start()

    hook = sys.unraisablehook
    replaced = {number: handler for number in (signal.SIGINT, *ending_signals())
                if (handler := signal.getsignal(number)) in (
                    signal.default_int_handler, signal.SIG_DFL)
                and current_thread() is main_thread()}
    for number in replaced:
        signal.signal(number, interrupt)
    if replaced:
        sys.unraisablehook = reraise
    try:
        yield received
    finally:
        again.cancel()
        sys.unraisablehook = hook
        for number, handler in replaced.items():
            if signal.getsignal(number) is interrupt:  # nodes replace it, also for the exit
                signal.signal(number, handler)


def print_refusal(error: BallbotError) -> None:
    """Print an error of this package; print several problems of a file on separate lines."""
    for problem in getattr(error, 'problems', ()) or (error,):
        print_error(str(problem))


def _run(words: list[str]) -> int:
    if words[:1] == ['help']:  # "ballbot help simulate", as in other programs
        words = [*words[1:2], '--help']
    verb = next((word for word in words if not word.startswith('-')), None)
    if verb is not None and verb not in VERBS:
        raise ConfigurationError(
            f'{verb!r} is not a command{suggestion(verb, VERBS)}; see ballbot --help',
            'unknown_name', verb)
    parser = parser_of([] if verb is None else [verb])
    if parser.of_verb is not None:
        parser.words = parser.of_verb.words = words
    try:
        arguments = parser.parse_args(words)
    except SystemExit as ending:  # --help and --version
        return ending.code if isinstance(ending.code, int) else FAILED
    if arguments.verb is None:
        parser.print_help()
        return MISUSED
    quiet = getattr(arguments, 'quiet', False)
    try:
        with _warnings(quiet), empty_folders_removed(), \
                nullcontext() if quiet else compilation_shown():
            code: int = load_verb(arguments.verb).run(arguments)
    except ConfigurationError as error:
        # The message names the class that checks the number, and its field: name the option.
        option = f'--{error.field.replace("_", "-")}'
        place = re.match(rf'\w+: {re.escape(error.field)}\b', str(error))
        if place and not error.problems and parser.of_verb is not None \
                and option in parser.of_verb._option_string_actions:
            raise ConfigurationError(
                option + str(error)[place.end():], error.reason, error.field) from error
        raise
    return code


@contextmanager
def _warnings(quiet: bool) -> Iterator[None]:
    """Print each distinct plausibility warning once, as a line; if quiet, log errors only."""
    log = logging.getLogger('ballbot_ros')
    level = log.level
    if quiet:
        log.setLevel(logging.ERROR)
    shown: set[str] = set()

    def show(message: Any, category: type[Warning], *rest: Any, **options: Any) -> None:
        if not issubclass(category, PlausibilityWarning):
            python_show(message, category, *rest, **options)
        elif str(message) not in shown:
            shown.add(str(message))
            note(f'Warning: {message}')

    try:
        with warnings.catch_warnings():
            warnings.simplefilter('always', PlausibilityWarning)
            python_show = warnings.showwarning
            warnings.showwarning = show
            yield
    finally:
        log.setLevel(level)
