# SPDX-License-Identifier: Apache-2.0
"""
State lattice of poses, and the search on it.

A state is the centre of a cell of a square grid with one of 16 headings: those of the vectors
(1, 0), (2, 1), (1, 1), (1, 2) and so on.  A motion primitive leads along the heading, or along an
arc to a neighbouring heading; it ends exactly on a state, and its curvature is within the limit of
the robot (Pivtoraiko and Kelly, 2005).  Each primitive exists forward and backward.
"""
import math
from typing import Any, Dict, List, NamedTuple, Sequence, Tuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.jit import compiled

VECTORS = ((1, 0), (2, 1), (1, 1), (1, 2), (0, 1), (-1, 2), (-1, 1), (-2, 1),
           (-1, 0), (-2, -1), (-1, -1), (-1, -2), (0, -1), (1, -2), (1, -1), (2, -1))
HEADINGS = tuple(math.atan2(y, x) for x, y in VECTORS)
LENGTHS = tuple(math.hypot(x, y) for x, y in VECTORS)
COUNT = len(VECTORS)
# Ratio of cell size to turning radius at which each leg of an arc is a single vector.
CELL_SHARE = 0.118
# Number of levels of the risk -log(probability) up to its limit.
LEVELS = 50
# Maximum number of nodes of a search; results of `expand` and `_place` that are no nodes.
NODES_MAX = 1 << 22
NONE, FULL, EXCLUDED = -1, -2, -3
NO_STATES, NO_TIMES = np.zeros(0, np.int64), np.zeros(0)


class Primitive(NamedTuple):
    """
    A motion from the cell (0, 0).

    Attributes
    ----------
    start, end : int
        Indices of the headings.
    direction : int
        1 forward, -1 backward.
    column, row : int
        Cell of the end.
    points : (n, 2) array
        Positions along the primitive [cells], without the first.
    curvature : float
        Curvature of the arc, yaw angle over travelled length [1/cell].
    length : float
        [cells]
    lines : float
        Length of the polyline along both headings to the end [cells].

    """

    start: int
    end: int
    direction: int
    column: int
    row: int
    points: NDArray[np.float64]
    curvature: float
    length: float
    lines: float


def primitives(radius: float) -> List[Primitive]:
    """Return the primitives for a turning radius [cells], sorted by start heading."""
    forward: List[Primitive] = []
    for start in range(COUNT):
        x, y = VECTORS[start]
        length = math.hypot(x, y)
        points = np.array([(0.5 * x, 0.5 * y), (x, y)] if length > 1.0 else [(x, y)], float)
        forward.append(Primitive(start, start, 1, x, y, points, 0.0, length, length))
        forward += [_arc(start, (start + turn) % COUNT, turn, radius) for turn in (1, -1)]
    backward = [Primitive(
        item.end, item.start, -1, -item.column, -item.row,
        np.vstack([item.points[-2::-1], np.zeros((1, 2))]) - (item.column, item.row),
        -item.curvature, item.length, item.lines) for item in forward]
    return sorted(forward + backward, key=lambda item: item.start)


def _arc(start: int, end: int, turn: int, radius: float) -> Primitive:
    """Return the shortest line, arc and line between two headings."""
    one, two = np.array(VECTORS[start], float), np.array(VECTORS[end], float)
    lengths = np.hypot(*one), np.hypot(*two)
    angle = turn * math.acos(min(1.0, one @ two / (lengths[0] * lengths[1])))
    tangent = radius * math.tan(0.5 * abs(angle))
    # The corner is an integer number of vectors, at least the tangent length, from both ends.
    first, second = (math.ceil(tangent / length - 0.01) for length in lengths)
    legs = first * lengths[0], second * lengths[1]
    tangent = min(legs)
    curvature = math.tan(0.5 * abs(angle)) / tangent
    corner = first * one
    arc = abs(angle) / curvature
    length = legs[0] + legs[1] - 2.0 * tangent + arc
    points = []
    for along in np.linspace(0.0, length, max(2, math.ceil(length / 0.5)) + 1)[1:]:
        if along <= legs[0] - tangent:
            point = one / lengths[0] * along
        elif along >= legs[0] - tangent + arc:
            point = corner + two / lengths[1] * (legs[1] - length + along)
        else:
            turned = (along - legs[0] + tangent) * curvature
            left = np.array([-one[1], one[0]]) / lengths[0] * turn
            begin = corner - one / lengths[0] * tangent
            point = begin + (math.sin(turned) * one / lengths[0]
                             + (1.0 - math.cos(turned)) * left) / curvature
        points.append(point)
    final = first * np.array(VECTORS[start]) + second * np.array(VECTORS[end])
    return Primitive(start, end, 1, int(final[0]), int(final[1]), np.array(points),
                     turn * curvature, length, sum(legs))


class Moves(NamedTuple):
    """
    The primitives as arrays, sorted by start heading, with n primitives for each heading.

    Attributes
    ----------
    ends : (16 * n,) array of int64
        Index of the end state minus that of the start state.
    cells : (16 * n, k) array of int64
        Indices of the cells around the points of the primitive minus that of its first cell, in
        order of travel; the last index is repeated.
    backward : (16 * n,) array of bool
    times : (16 * n,) array
        [s]

    """

    ends: NDArray[np.int64]
    cells: NDArray[np.int64]
    backward: NDArray[np.bool_]
    times: NDArray[np.float64]

    @classmethod
    def of(cls, rows: List[Primitive], times: List[float], columns: int) -> 'Moves':
        """Return the arrays for primitives, their times [s], and the columns of the grid."""
        ways = [cells_around(item.points) for item in rows]
        longest = max(map(len, ways))
        ends = [(item.row * columns + item.column) * COUNT + item.end - item.start
                for item in rows]
        cells = np.array([way + way[-1:] * (longest - len(way)) for way in ways], np.int64)
        return cls(np.array(ends, np.int64), cells @ (columns, 1),
                   np.array([item.direction < 0 for item in rows]), np.array(times))


def cells_around(points: NDArray[np.float64]) -> List[Tuple[int, int]]:
    """Return (row, column) of the cells whose centres surround the points [cells]."""
    found: Dict[Tuple[int, int], None] = {}
    for x, y in np.round(points, 6).tolist():
        for row in (math.floor(y), math.ceil(y)):
            found.update(((row, column), None) for column in (math.floor(x), math.ceil(x)))
    return list(found)


class Problem(NamedTuple):
    """
    A search problem; a state is cell * 16 + heading, cells are indexed row by row.

    Attributes
    ----------
    starts : (n,) array of int64
        Start states.
    start_costs : (n,) array
        [s]
    goal_cell, goal_heading : int
        A heading of -1 means any.
    slowness : (cells,) array
        Factor on times in a cell; infinite where the centre must not be, and at the border.
    heuristic : (cells * 16,) array
        Lower bound of the time to the goal [s], inflated by `route.HEURISTIC_FACTOR`.
    moves : Moves
    reversal : float
        Time for a change of direction [s].
    arc_starts, arc_ends : (m,) arrays of int64
        Start and end states of the crossings, sorted by start.
    arc_times, arc_levels : (m,) arrays
        Time [s] and risk level of each crossing.
    first_ends : (m,) array of int64
        End states of the crossings that start at the pose of the ball; negative if one cannot.
    leaving : (2,) array of bool
        Whether the first motion may lead forward, and backward.
    most_level : int

    """

    starts: NDArray[np.int64]
    start_costs: NDArray[np.float64]
    goal_cell: int
    goal_heading: int
    slowness: NDArray[np.float64]
    heuristic: NDArray[np.float64]
    moves: Moves
    reversal: float
    arc_starts: NDArray[np.int64]
    arc_ends: NDArray[np.int64]
    arc_times: NDArray[np.float64]
    arc_levels: NDArray[np.int64]
    first_ends: NDArray[np.int64]
    leaving: NDArray[np.bool_]
    most_level: int


class SearchTree(NamedTuple):
    """
    The nodes of a search: one for each path to a state that no other path excludes.

    Attributes
    ----------
    states, parents, moves, levels : arrays of int32
        State, parent node, move and risk level of each node.
    older : array of int32
        Previous node of the same state, -1 for none.
    backward, closed : arrays of bool
    costs : array
        [s]
    heap_costs : array
    heap_nodes : array of int32

    """

    states: NDArray[np.int32]
    parents: NDArray[np.int32]
    moves: NDArray[np.int32]
    levels: NDArray[np.int32]
    older: NDArray[np.int32]
    backward: NDArray[np.bool_]
    closed: NDArray[np.bool_]
    costs: NDArray[np.float64]
    heap_costs: NDArray[np.float64]
    heap_nodes: NDArray[np.int32]

    @classmethod
    def of(cls, count: int) -> 'SearchTree':
        """Allocate the arrays for a number of nodes."""
        states, parents, moves, levels, older = np.empty((5, count), np.int32)
        backward, closed = np.empty((2, count), np.bool_)
        return cls(states, parents, moves, levels, older, backward, closed, np.empty(count),
                   np.empty(3 * count), np.empty(3 * count, np.int32))


class Tree:
    """A search tree that searches reuse and that grows on demand."""

    def __init__(self) -> None:
        self._nodes = SearchTree.of(1 << 18)

    def find(self, problem: Problem) -> Tuple[float, List[Tuple[int, int]]]:
        """
        Return the least time to the goal, and the path.

        Returns
        -------
        time : float
            [s]; infinite if there is no path.
        path : list of (int, int)
            State, and the move to it: the index of a primitive, -2 - index of a crossing, or -1
            for the start.

        """
        while True:
            found = expand(problem, self._nodes,
                           np.full(problem.slowness.size * COUNT, -1, np.int32))
            if found != FULL or len(self._nodes.states) >= NODES_MAX:
                break
            self._nodes = SearchTree.of(4 * len(self._nodes.states))
        if found < 0:
            return math.inf, []
        path, node = [], found
        while node >= 0:
            path.append((int(self._nodes.states[node]), int(self._nodes.moves[node])))
            node = int(self._nodes.parents[node])
        return float(self._nodes.costs[found]), path[::-1]


@compiled
def free_steps(barriers: NDArray[np.bool_], row: float, column: float, up: float, across: float,
               most: int) -> int:
    """Return the number of steps (up, across) from a position to a barrier, at most `most`."""
    for number in range(most):
        r, c = math.floor(row + (number + 1) * up), math.floor(column + (number + 1) * across)
        if not (0 <= r < len(barriers) and 0 <= c < barriers.shape[1]) or barriers[r, c]:
            return number
    return most


@compiled
def _place(tree: SearchTree, newest: NDArray[np.int32], state: int, level: int, backward: bool,
           cost: float, reversal: float) -> int:
    """Return the node that a path to a state improves, `NONE` for a new one, or `EXCLUDED`."""
    found, node = NONE, newest[state]
    while node >= 0:
        same = tree.backward[node] == backward
        if tree.levels[node] <= level and cost >= tree.costs[node] + (0.0 if same else reversal):
            return EXCLUDED
        if same and tree.levels[node] == level:
            found = EXCLUDED if tree.closed[node] else node
        node = tree.older[node]
    return found


@compiled
def _push(heap_costs: NDArray[np.float64], heap_nodes: NDArray[np.int32], size: int,
          cost: float, node: int) -> None:
    """Add a node to a binary heap of the given size."""
    place = size
    while place > 0 and heap_costs[(place - 1) // 2] > cost:
        heap_costs[place] = heap_costs[(place - 1) // 2]
        heap_nodes[place] = heap_nodes[(place - 1) // 2]
        place = (place - 1) // 2
    heap_costs[place], heap_nodes[place] = cost, node


@compiled
def _pop(heap_costs: NDArray[np.float64], heap_nodes: NDArray[np.int32], size: int) -> None:
    """Remove the first node of a binary heap of the given size."""
    size -= 1
    cost, node, place = heap_costs[size], heap_nodes[size], 0
    while 2 * place + 1 < size:
        child = 2 * place + 1
        if child + 1 < size and heap_costs[child + 1] < heap_costs[child]:
            child += 1
        if heap_costs[child] >= cost:
            break
        heap_costs[place], heap_nodes[place] = heap_costs[child], heap_nodes[child]
        place = child
    heap_costs[place], heap_nodes[place] = cost, node


def turning_times(goals: NDArray[np.int64], starts: NDArray[np.int64],
                  slowness: NDArray[np.float64], paces: Sequence[float], turn: float,
                  arcs: Sequence[NDArray[Any]] = (NO_STATES, NO_STATES, NO_TIMES)
                  ) -> NDArray[np.float64]:
    """
    Return the times from all states to the goal of a point that turns in place [s].

    They are computed by Dijkstra's algorithm with buckets (Dial, 1969) up to the farthest of
    `starts`; states that are farther have the time at which the computation ended, a lower bound.

    Parameters
    ----------
    goals, starts : (n,), (m,) arrays of int64
        States.
    slowness : (rows, columns) array
        Factor on the times of steps that end in a cell in the direction of travel; infinite at
        the border.
    paces : (float, float)
        Time per length along the heading, forward and backward [s/cell].
    turn : float
        Time of a turn to the next heading [s].
    arcs : (k,), (k,), (k,) arrays
        Start and end states, and times [s], of further connections.

    """
    arc_starts, arc_ends, arc_times = arcs
    count, order = COUNT * slowness.size, np.argsort(arc_ends)
    far, width = np.full(count, math.inf), min(paces)
    longest = max(turn, *arc_times, max(LENGTHS) * max(paces) * slowness[
        slowness < math.inf].max(initial=1.0))
    after, before = np.full((2, count + 2 + int(longest / width)), NONE, np.int32)
    index = np.zeros(slowness.size + 1, np.int64)
    index[1:] = np.cumsum(np.bincount(arc_ends // COUNT, minlength=slowness.size))
    limit = _spread(goals, starts, slowness.ravel(), slowness.shape[1], np.array(paces), turn,
                    index, arc_starts[order], arc_ends[order], arc_times[order], width, far,
                    after, before)
    np.minimum(far, limit, out=far)
    return far


@compiled
def _link(after: NDArray[np.int32], before: NDArray[np.int32], node: int, first: int) -> None:
    """Add a node behind the first one of a list."""
    after[node], before[node] = after[first], first
    before[after[first]] = after[first] = node


@compiled
def _unlink(after: NDArray[np.int32], before: NDArray[np.int32], node: int) -> None:
    """Remove a node from its list."""
    after[before[node]], before[after[node]] = after[node], before[node]
    before[node] = NONE


@compiled
def _spread(goals: NDArray[np.int64], starts: NDArray[np.int64], slowness: NDArray[np.float64],
            columns: int, paces: NDArray[np.float64], turn: float, index: NDArray[np.int64],
            arc_starts: NDArray[np.int64], arc_ends: NDArray[np.int64],
            arc_times: NDArray[np.float64], width: float, far: NDArray[np.float64],
            after: NDArray[np.int32], before: NDArray[np.int32]) -> float:
    """
    Compute the times of `turning_times` in `far`; return the time up to which they are exact.

    The buckets are circular doubly linked lists, whose first nodes follow the states in `after`
    and `before`.  `index` has the first of the sorted arcs that end in each cell.
    """
    buckets = len(after) - len(far)
    for first in range(len(far), len(after)):
        after[first] = before[first] = first
    queued, bucket = 0, 0
    for goal in goals:
        far[goal] = 0.0
        _link(after, before, goal, len(far))
        queued += 1
    while queued > 0:
        first = len(far) + bucket % buckets
        state = after[first]
        if state == first:
            bucket += 1
            farthest = 0.0
            for start in starts:
                farthest = max(farthest, far[start])
            if farthest < bucket * width:
                return bucket * width
            continue
        _unlink(after, before, state)
        queued -= 1
        cell, heading, base = state // 16, state % 16, far[state]
        step = 16 * (VECTORS[heading][1] * columns + VECTORS[heading][0])
        length = LENGTHS[heading] * slowness[cell]
        for item in range(4 + index[cell + 1] - index[cell]):
            if item < 2:
                state_before, cost = 16 * cell + (heading + 1 - 2 * item) % 16, base + turn
            elif item < 4:
                state_before = state + (2 * item - 5) * step
                cost = base + paces[item - 2] * length
            else:
                arc = index[cell] + item - 4
                if arc_ends[arc] != state:
                    continue
                state_before, cost = arc_starts[arc], base + arc_times[arc]
            if 0 <= state_before < len(far) and cost < far[state_before] \
                    and slowness[state_before // 16] < math.inf:
                if before[state_before] != NONE:
                    _unlink(after, before, state_before)
                    queued -= 1
                far[state_before] = cost
                _link(after, before, state_before, len(far) + int(cost / width) % buckets)
                queued += 1
    return math.inf


@compiled
def expand(problem: Problem, tree: SearchTree, newest: NDArray[np.int32]) -> int:
    """
    Search by A* over (risk level, direction, heading, cell); return the node of the goal.

    Return `NONE` if there is no path, `FULL` if the arrays are too short.  A path to a state is
    excluded by another one with at most its risk level and cost; if their directions differ, the
    cost must be lower by a reversal.  `newest` has the newest node of each state, initially -1.
    """
    (starts, start_costs, goal_cell, goal_heading, slowness, heuristic, primitive, reversal,
     arc_starts, arc_ends, arc_times, arc_levels, first_ends, leaving, most_level) = problem
    ends, cells, sides, times = primitive
    states, parents, moves, levels, older, backward, closed, costs, heap_costs, heap_nodes = tree
    per = len(times) // 16
    size = len(starts)
    if size > len(states):
        return FULL
    # A start excludes no other path to its state: from there, crossings lead to other states.
    for node in range(size):
        states[node], costs[node], closed[node] = starts[node], start_costs[node], False
        parents[node], moves[node], levels[node], backward[node] = -1, -1, 0, False
        _push(heap_costs, heap_nodes, node, costs[node] + heuristic[states[node]], node)
    count = size
    while size > 0:
        expanded = heap_nodes[0]
        _pop(heap_costs, heap_nodes, size)
        size -= 1
        if closed[expanded]:
            continue
        closed[expanded] = True
        state, base, level = states[expanded], costs[expanded], levels[expanded]
        cell, heading = state // 16, state % 16
        if cell == goal_cell and (goal_heading < 0 or heading == goal_heading):
            return int(expanded)
        first = np.searchsorted(arc_starts, state)
        number = per
        while first + number - per < len(arc_starts) \
                and arc_starts[first + number - per] == state:
            number += 1
        for item in range(number):
            new_level, side = level, False
            if item < per:
                move = heading * per + item
                target, side = state + ends[move], sides[move]
                if not 0 <= target < 16 * len(slowness) \
                        or parents[expanded] < 0 and not leaving[1 if side else 0]:
                    continue
                cost = base + (reversal if side != backward[expanded] else 0.0)
                # Most moves are excluded before their cells are read.
                if _place(tree, newest, target, level, side, cost + times[move],
                          reversal) == EXCLUDED:
                    continue
                factor = 0.0
                for index in range(cells.shape[1]):
                    factor = max(factor, slowness[cell + cells[move, index]])
                    if factor == math.inf:
                        break
                cost += times[move] * factor
            else:
                arc = first + item - per
                new_level = level + arc_levels[arc]
                target, cost, move = arc_ends[arc], base + arc_times[arc], -2 - arc
                if parents[expanded] < 0:
                    target = first_ends[arc]
                if new_level > most_level or target < 0:
                    continue
            cost_to_goal = cost + heuristic[target]
            if cost_to_goal == math.inf:
                continue
            node = _place(tree, newest, target, new_level, side, cost, reversal)
            if node == EXCLUDED:
                continue
            if node == NONE:
                if count == len(states):
                    return FULL
                node = count
                count += 1
                states[node], closed[node], levels[node] = target, False, new_level
                backward[node], older[node] = side, newest[target]
                newest[target] = node
            costs[node], parents[node], moves[node] = cost, expanded, move
            if size == len(heap_costs):
                return FULL
            _push(heap_costs, heap_nodes, size, cost_to_goal, node)
            size += 1
    return NONE
