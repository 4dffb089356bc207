# SPDX-License-Identifier: Apache-2.0
"""The messages of one robot in a bag, MCAP or SQLite; needs no ROS installation."""
from pathlib import Path
from typing import Any, Iterator, List, Mapping, Tuple

from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import get_typestore, Stores
import yaml

from ballbot_ros.bags.metadata import BagMetadata
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.view.assembly import TOPICS

# What states the robot; more of these than frames are wanted are not even decoded.
STATES = ('ball_state', 'joint_states')
# Parameters of the decision that the page needs, too.
CURVE = ('curve', 'variant')


class BagReading:
    """
    A bag of which the messages for frames are read.

    Parameters
    ----------
    path : Path
        Folder of the bag, or a file ending in .mcap.
    namespace : str
        Of the robot, where the bag has several.

    Attributes
    ----------
    path : Path
    parameters : mapping
        Of the node that was the source, where the bag says so, and the height curve of the
        decision.

    Raises
    ------
    ConfigurationError
        For what is no bag of a robot, and for a bag of several where none is named.

    """

    def __init__(self, path: Path, namespace: str = ''):
        """Look what is in it."""
        # What `ballbot demo` leaves for each act is a folder with a bag in it.
        self.path = path / 'bag' if (path / 'bag' / 'metadata.yaml').is_file() else path
        with self._opened() as reader:
            topics = {connection.topic for connection in reader.connections
                      if _name(connection) in STATES}
        prefixes = sorted({topic.rsplit('/', 1)[0] for topic in topics})
        asked = '/' + namespace.strip('/') if namespace.strip('/') else ''
        if namespace:
            prefixes = [prefix for prefix in prefixes if prefix == asked]
        if not prefixes:
            raise ConfigurationError(
                f'{path}: has neither {" nor ".join(STATES)}'
                + (f' in the namespace {asked}' if namespace else ''))
        if len(prefixes) > 1:
            raise ConfigurationError(
                f'{path}: has several robots, {", ".join(p or "/" for p in prefixes)}: choose one '
                'with --namespace')
        self._prefix = prefixes[0]
        # Who knows the true state needs no joint states.
        self._wanted = [f'{self._prefix}/{name}' for name in TOPICS if not (
            name == 'joint_states' and f'{self._prefix}/ball_state' in topics)]
        told = self._metadata()
        self.parameters: Mapping[str, Any] = {
            **{name: told.decision[name] for name in CURVE if name in told.decision},
            **told.parameters}

    def messages(self, least: float, most: int) -> Iterator[Tuple[str, Any, float]]:
        """
        Yield the last part of the name of a topic, a message, and the part of the bag read.

        Parameters
        ----------
        least : float
            Between two states [s]; others in between are left out.
        most : int
            States to yield, about.

        Raises
        ------
        ConfigurationError
            If the bag turns out to be broken.

        """
        last = -10**18
        count = states = 0
        with self._opened() as reader:
            wanted: List[Any] = [connection for connection in reader.connections
                                 if connection.topic in self._wanted]
            whole = max(sum(connection.msgcount for connection in wanted), 1)
            every = max(1, sum(connection.msgcount for connection in wanted
                               if _name(connection) in STATES) // max(most, 1))
            try:
                for count, (connection, time, data) in enumerate(reader.messages(wanted), 1):
                    if _name(connection) in STATES:
                        states += 1
                        if states % every or 0 <= time - last < 0.9e9 * least:
                            continue
                        last = time
                    message = reader.deserialize(data, connection.msgtype)
                    yield _name(connection), message, min(count / whole, 1.0)
            except (AnyReaderError, OSError, KeyError, ValueError, AssertionError) as error:
                raise ConfigurationError(
                    f'{self.path}: breaks off: {error or type(error).__name__}') from error

    def _opened(self) -> AnyReader:
        try:
            reader = AnyReader([self.path], default_typestore=get_typestore(Stores.ROS2_JAZZY))
            reader.open()
            reader.close()
            return reader
        except (AnyReaderError, OSError, KeyError, ValueError, AssertionError) as error:
            raise ConfigurationError(
                f'{self.path}: is no bag that can be read: {error or type(error).__name__}'
            ) from error

    def _metadata(self) -> BagMetadata:
        """Return what the bag says of its making, which a file alone does not."""
        folder = self.path if self.path.is_dir() else self.path.parent
        try:
            content = yaml.safe_load((folder / 'metadata.yaml').read_text(encoding='utf-8'))
            texts = content['rosbag2_bagfile_information'].get('custom_data') or {}
        except (OSError, yaml.YAMLError, TypeError, KeyError, AttributeError):
            texts = {}
        return BagMetadata.read({str(key): str(text) for key, text in texts.items()})


def _name(connection: Any) -> str:
    """Return the last part of the name of a topic."""
    return str(connection.topic).rsplit('/', 1)[-1]
