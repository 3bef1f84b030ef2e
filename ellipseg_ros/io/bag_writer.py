"""A bag writer whose file is a complete bag after every flush, in case the process is killed."""

import shutil
from contextlib import suppress
from io import BufferedWriter
from pathlib import Path
from types import MappingProxyType
from typing import Literal, cast

from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.errors import WriterError
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.typesys.store import Typestore

BAG_VERSION: Literal[9] = 9  # of the bag format: that of Jazzy
MAX_PENDING_BYTES = 4 * 1024 * 1024  # after which the bag is flushed
BUFFER_BYTES = 4 * MAX_PENDING_BYTES  # one message may exceed the limit
MAX_INDEX_RATIO = 8  # bytes of index that are written per byte of messages


class _Storage(McapWriter):
    """An mcap file whose new content is buffered in memory until `close`."""

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        super().__init__(path, compression)
        self.index_bytes = 0  # of the last index
        self.metadata = ""
        end = self.bio.tell()
        self.bio.close()
        self._open_at(end)

    def close(self, version: int, metadata: str) -> None:
        """Write the pending content, then the index over the earlier one; may be repeated."""
        if self.chunk.bio.tell():
            self.close_chunk()
        end = self.bio.tell()
        self.metadata = metadata
        super().close(version, metadata)
        self.index_bytes = self.path.stat().st_size - end
        self._open_at(end)

    def _open_at(self, end: int) -> None:
        self.end = end  # of the content in the file
        file = self.path.open("r+b", buffering=BUFFER_BYTES)
        file.seek(end)
        self.bio = cast(BufferedWriter, file)  # rosbags uses no other methods of it

    @property
    def pending_bytes(self) -> int:
        """Bytes that are not yet in the file."""
        return self.chunk.bio.tell() + self.bio.tell() - self.end

    def abort(self) -> None:
        """Close the file; pending content has no index."""
        with suppress(OSError):  # a full disk
            self.bio.close()


class _Bag(Writer):
    STORAGE_PLUGINS = MappingProxyType({StoragePlugin.MCAP: _Storage})


class BagWriter:
    """Writes a ROS 2 bag (mcap, zstd) that every reader can open after each `end_update`.

    rosbags writes the index and metadata.yaml, without which a bag can't be read, at the end.
    Here the bag is completed in memory at every flush; new messages and the new index then
    replace the old index in the file by one write. A process killed during that call, some
    milliseconds of every few hundred, leaves a file that needs `mcap recover`.
    Raises OSError.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._writer = _Bag(path, version=BAG_VERSION, storage_plugin=StoragePlugin.MCAP)
        except WriterError as error:  # the folder was created after the check
            raise FileExistsError(str(error)) from error
        self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        try:
            self._writer.open()
            self._storage = cast(_Storage, self._writer.storage)
            self._messages = 0  # written
            self._messages_in_metadata = 0
            self.complete()
        except BaseException:
            shutil.rmtree(path, ignore_errors=True)
            raise

    def add_connection(self, topic: str, kind: str, types: Typestore) -> Connection:
        """Add a topic with messages of a type."""
        self._messages_in_metadata = 0
        return self._writer.add_connection(topic, kind, typestore=types)

    def write(self, connection: Connection, time_ns: int, message: bytes) -> None:
        """Write a serialized message."""
        self._writer.write(connection, time_ns, message)
        self._messages += 1
        if self._storage.pending_bytes >= MAX_PENDING_BYTES:
            self.end_update()

    def end_update(self) -> None:
        """Flush, unless the pending content is small compared with the index of a long bag."""
        if self._storage.pending_bytes >= self._storage.index_bytes // MAX_INDEX_RATIO:
            # metadata.yaml, which is slow to write, only after a tenth more.
            if self._messages > 1.1 * self._messages_in_metadata:
                self.complete()
            else:
                self._storage.close(BAG_VERSION, self._storage.metadata)

    def complete(self) -> None:
        """Flush everything, including metadata.yaml."""
        self._writer.close()
        self._writer.storage = self._storage  # for further messages
        self._messages_in_metadata = self._messages

    def close_file(self) -> None:
        """Close the file; content that is not flushed has no index."""
        self._storage.abort()
