"""A bag that is whole between two writes: who is killed leaves what he had to tell."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedWriter, BytesIO
from pathlib import Path
from types import MappingProxyType
from typing import Literal, cast

from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.errors import WriterError
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.typesys.store import Typestore

RECORDING: Literal[9] = 9  # version of the bag format that is written: that of Jazzy
ENOUGH = 4 * 1024 * 1024  # bytes that wait in memory, at most, whatever is written
DEAREST = 8  # at most so many bytes of index are written for a byte of messages


class _Waiting(BytesIO):
    """The part of a file from `start` on, kept in memory."""

    def __init__(self, start: int) -> None:
        super().__init__()
        self.start = start

    def tell(self) -> int:
        """The place in the file."""
        return self.start + super().tell()

    def close(self) -> None:
        """Not yet: its content is still to be written."""


class _Storage(McapWriter):
    """The file; all that is written to it waits in memory until it is wanted."""

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        super().__init__(path, compression)
        start = self.bio.tell()
        self.bio.close()
        self._wait_from(start)
        self.file = self.path.open("r+b", buffering=0)
        self.index = 0  # bytes of the last one
        self.metadata = ""

    def close(self, version: int, metadata: str) -> None:
        """Write what waits, and behind it the index; may be called again and again."""
        if self.chunk.bio.tell():
            self.close_chunk()
        end = self.waiting.tell()
        self.metadata = metadata
        super().close(version, metadata)
        data = self.waiting.getbuffer()
        self.file.seek(self.waiting.start)
        written = 0
        while written < len(data):
            written += self.file.write(data[written:])
        self.index = self.waiting.tell() - end
        self._wait_from(end)

    def _wait_from(self, start: int) -> None:
        self.waiting = _Waiting(start)
        self.bio = cast(BufferedWriter, self.waiting)  # of which rosbags uses no more than that

    def abort(self) -> None:
        """Go without what waits."""
        self.file.close()


class _Bag(Writer):
    STORAGE_PLUGINS = MappingProxyType({StoragePlugin.MCAP: _Storage})


class BagWriter:
    """Writes a ROS 2 bag (mcap, zstd) that every reader can open after each `end_update`.

    rosbags writes the index and metadata.yaml, without which a bag can't be read, at the end.
    Here it ends the bag in memory, again and again; what came since the last time and the new
    index then go into the file in one call, over the old index. Who is killed within that call,
    some milliseconds of every few hundred, leaves a file that `mcap recover` has to mend.
    Raises OSError.
    """

    def __init__(self, path: Path) -> None:
        with _as_os_error():
            self._writer = _Bag(path, version=RECORDING, storage_plugin=StoragePlugin.MCAP)
        self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        try:
            self._writer.open()
            self._storage = cast(_Storage, self._writer.storage)
            self._messages = self._told = 0  # written; in metadata.yaml
            self._secure_all()
        except BaseException:
            shutil.rmtree(path, ignore_errors=True)
            raise

    def add_connection(self, topic: str, kind: str, types: Typestore) -> Connection:
        """A topic, and the type of its messages."""
        self._told = 0
        return self._writer.add_connection(topic, kind, typestore=types)

    def write(self, connection: Connection, time_ns: int, message: bytes) -> None:
        """A serialized message."""
        self._writer.write(connection, time_ns, message)
        self._messages += 1
        if self._waiting >= max(ENOUGH, self._storage.index // DEAREST):
            self._secure()

    def end_update(self) -> None:
        """Secure what was written, unless that is little beside the index of a long bag."""
        if self._waiting >= self._storage.index // DEAREST:
            self._secure()

    def close(self) -> None:
        """Secure the rest, and end."""
        self._secure_all()
        self._storage.abort()

    def abort(self) -> None:
        """End, with what was secured."""
        self._storage.abort()

    @property
    def _waiting(self) -> int:
        """Bytes that a kill would lose."""
        return self._storage.chunk.bio.tell() + len(self._storage.waiting.getbuffer())

    def _secure(self) -> None:
        """Make the file a whole bag; metadata.yaml, which takes long, only for a tenth more."""
        if self._messages > 1.1 * self._told:
            self._secure_all()
        else:
            self._storage.close(RECORDING, self._storage.metadata)

    def _secure_all(self) -> None:
        self._writer.close()
        self._writer.storage = self._storage  # it goes on
        self._told = self._messages


@contextmanager
def _as_os_error() -> Iterator[None]:
    try:
        yield
    except WriterError as error:  # the folder came between the look and the writing
        raise FileExistsError(str(error)) from error
