# SPDX-License-Identifier: Apache-2.0
"""An observer of running nodes, which publishes and calls services only on request."""
from concurrent.futures import Future, TimeoutError as TooLong
from queue import Empty, Queue
from threading import Event, Thread
from time import monotonic
from typing import Any, Callable, Dict, FrozenSet, Mapping, NamedTuple, Optional, Tuple, Union

from geometry_msgs.msg import PoseStamped
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from ballbot_ros.errors import RefusedError
from ballbot_ros.ros import qos
from ballbot_ros.ros.cmd_vel import SpeedPublisher
from ballbot_ros.ros.endpoints import create_publisher, create_subscription
from ballbot_ros.ros.frames import PENDULUM
from ballbot_ros.ros.graph import Observer
from ballbot_ros.ros.topics import message_class, TOPICS
from ballbot_ros.srv import Step

# Displayed topics, each with the minimum time between two messages [s].
MESSAGE_PERIODS: Mapping[str, float] = {
    'ball_state': 0.0, 'joint_states': 0.008, 'odom': 0.008, 'step_observation': 0.1,
    'terrain_observation': 0.1, 'step_decision': 0.0, 'motor_status': 0.05, 'e_stop': 0.0}

# Recognized nodes, and their displayed parameters.
NODES: Mapping[str, Tuple[str, ...]] = {
    'simulator': ('scene', 'robot', 'control_rate', 'floor', 'start'), 'bridge': ('hardware',),
    'emulated_robot': ('scene',), 'controller': ('robot',),
    'obstacle_decision': ('robot', 'curve', 'variant'), 'navigator': ('map_frame',)}

SERVICE_TIMEOUT = 5.0  # timeout of a service call [s]
GRAPH_PERIOD = 1.0  # period of the graph query [s]
SET_POINT_PERIOD = 0.05  # period of a held set-point [s]
ATTEND_TIMEOUT = 1.0  # a held set-point is released after this time without `attend` [s]
SPIN_TIMEOUT = 0.02  # longest wait for messages [s]


class Presence(NamedTuple):
    """Nodes in the graph."""

    nodes: FrozenSet[str]  # those of `NODES`
    drivers: Tuple[str, ...]  # other nodes that publish set-points
    followers: int  # number of subscribers to set-points


class Spectator:
    """
    Receives messages of nodes in its own thread, and drops messages above the display rate.

    It subscribes best effort to fast topics, so that no publisher waits for it.  In the thread,
    `receive` is called with the name of a topic and a message, and `learn` with the name of a node
    and its parameters.  Raises `ConfigurationError` if the namespace is not valid.
    """

    def __init__(self, namespace: str, receive: Callable[[str, Any], None],
                 learn: Callable[[str, Dict[str, Any]], None]):
        self._receive, self._learn = receive, learn
        self._observer = Observer('view', namespace)
        self._node = self._observer.node
        self._jobs: 'Queue[Callable[[], None]]' = Queue()
        self._ending = Event()
        self._asked: Dict[str, float] = {}
        self._clients: Dict[str, Any] = {}
        self._publisher: Optional[Any] = None  # of set-points
        self._speeds: Optional[SpeedPublisher] = None
        self._goals: Optional[Any] = None  # publisher
        self._goal: Optional[PoseStamped] = None  # pending until a node subscribes
        self._held: Union[float, JointState, None] = None  # a speed [m/s], or a set-point
        self._attended = 0.0
        self.presence = Presence(frozenset(), (), 0)
        for topic, period in MESSAGE_PERIODS.items():
            create_subscription(self._node, topic, self._taking(topic, period),
                                profile=qos.watching(topic), raw=True)
        self._thread = Thread(target=self._run, name='spectator', daemon=True)

    def start(self) -> None:
        """Start the thread, which receives messages."""
        self._thread.start()

    def close(self) -> None:
        """Stop the thread and leave the graph."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join()
        self._observer.close()

    def trigger(self, service: str) -> str:
        """Call a Trigger service and return its message; raise `RefusedError` if it refuses."""
        return self._call(Trigger, service, Trigger.Request())

    def step(self, periods: int) -> None:
        """Step a paused simulator by control periods; raise `RefusedError` if it refuses."""
        self._call(Step, 'simulator/step', Step.Request(periods=periods))

    def hold_speed(self, speed: float) -> None:
        """Publish a speed [m/s] periodically."""
        self._held = float(speed)

    def hold_angle(self, angle: float) -> None:
        """Publish an absolute pendulum angle [rad] periodically."""
        self._held = JointState(name=[PENDULUM], position=[angle])

    def go_to(self, x: float, y: float, frame: str) -> None:
        """Publish a position in a frame as the goal [m], with any heading."""
        goal = PoseStamped()
        goal.header.frame_id = frame
        goal.pose.position.x, goal.pose.position.y = x, y
        goal.pose.orientation.w = 0.0  # all zeros: any heading
        self._goal = goal

    def release_set_point(self) -> None:
        """Stop publishing set-points."""
        self._held = None

    @property
    def holding(self) -> bool:
        """Return whether a set-point is published."""
        return self._held is not None

    def attend(self) -> None:
        """Renew the held set-point, which is otherwise released after a timeout."""
        self._attended = monotonic()

    def ask_again(self) -> None:
        """Request the parameters of all nodes again; called in the thread."""
        self._asked.clear()

    # Methods of the thread.

    def _run(self) -> None:
        query = renew = 0.0
        while not self._ending.is_set():
            self._observer.spin(SPIN_TIMEOUT)
            now = monotonic()
            try:
                while True:
                    self._jobs.get_nowait()()
            except Empty:
                pass
            if now >= query:
                query = now + GRAPH_PERIOD
                self._query_graph(now)
            if now >= renew:
                renew = now + SET_POINT_PERIOD
                self._publish(now)

    def _taking(self, topic: str, period: float) -> Callable[[bytes], None]:
        """Return a callback that decodes at most one message per period."""
        kind, last = message_class(TOPICS[topic].type), [-1e9]

        def take(data: bytes) -> None:
            now = monotonic()
            if now - last[0] >= period:
                last[0] = now
                self._receive(topic, deserialize_message(data, kind))
        return take

    def _query_graph(self, now: float) -> None:
        own = self._node.get_namespace()
        nodes = frozenset(name for name, where in self._node.get_node_names_and_namespaces()
                          if where == own and name in NODES)
        drivers = {info.node_name for topic in ('set_point', 'cmd_vel')
                   for info in self._node.get_publishers_info_by_topic(
                       self._node.resolve_topic_name(topic))} - {self._node.get_name()}
        followers = sum(self._node.count_subscribers(self._node.resolve_topic_name(topic))
                        for topic in ('set_point', 'cmd_vel'))
        self.presence = Presence(nodes, tuple(sorted(drivers)), followers)
        for name in [known for known in self._asked if known not in nodes]:
            del self._asked[name]
        for name in nodes:
            if now - self._asked.get(name, -1e9) > SERVICE_TIMEOUT:
                self._ask(name, now)

    def _ask(self, name: str, now: float) -> None:
        """Request the parameters of a node, again after a timeout without an answer."""
        client = self._client(GetParameters, f'{name}/get_parameters')
        if not client.service_is_ready():
            return
        self._asked[name] = now

        def answered(future: Any) -> None:
            if future.result() is None:
                return
            values = map(parameter_value_to_python, future.result().values)
            self._asked[name] = float('inf')
            self._learn(name, dict(zip(NODES[name], values)))

        client.call_async(GetParameters.Request(names=list(NODES[name]))
                          ).add_done_callback(answered)

    def _client(self, kind: Any, service: str) -> Any:
        if service not in self._clients:
            self._clients[service] = self._node.create_client(kind, service)
        return self._clients[service]

    def _call(self, kind: Any, service: str, request: Any) -> str:
        """Call a service from another thread, and return the message of its answer."""
        pending: 'Future[Any]' = Future()
        self._jobs.put(lambda: self._client(kind, service).call_async(request).add_done_callback(
            lambda done: pending.set_result(done.result())))
        try:
            answer = pending.result(SERVICE_TIMEOUT)
        except TooLong:
            raise RefusedError(
                f'{service} has not answered for {SERVICE_TIMEOUT:g} s', 'timeout',
                service) from None
        if not answer.success:
            raise RefusedError(answer.message, 'refused', service)
        return str(answer.message)

    def _publish(self, now: float) -> None:
        if self._goal is not None:
            if self._goals is None:
                self._goals = create_publisher(self._node, 'goal_pose')
            if self._goals.get_subscription_count():
                self._goals.publish(self._goal)
                self._goal = None
        if now - self._attended > ATTEND_TIMEOUT:
            self._held = None
        held = self._held
        if self._publisher is not None and not isinstance(held, JointState):
            self._node.destroy_publisher(self._publisher)  # other nodes may drive then
            self._publisher = None
        if self._speeds is not None and not isinstance(held, float):
            self._speeds.close()
            self._speeds = None
        if isinstance(held, float):
            self._speeds = self._speeds or SpeedPublisher(self._node)
            self._speeds.publish(held)
        elif held is not None:
            self._publisher = self._publisher or create_publisher(
                self._node, 'set_point', profile=qos.LATEST)
            self._publisher.publish(held)
