"""Changes files as faulty disks and liars do."""

from collections.abc import Callable
from pathlib import Path
import struct
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

_RECORD = struct.Struct('<BQ')
_SUMS_AT = {
    0x06: 24,
    0x0F: 0,
    0x02: 16,
}  # in the body of a chunk, of the data's end, of the footer
_FOOTER = 0x02


def changed_byte(
    path: Path, near: bytes, *, last: bool = False, behind: bool = False, flipped: int = 1
) -> None:
    """Flip bits of one byte.

    Args:
        near: what the byte is the first one of.
        last: whether that is looked for from the end.
        behind: whether the byte is the one after that instead.
    """
    content = bytearray(path.read_bytes())
    at = (content.rindex if last else content.index)(near) + behind * len(near)
    content[at] ^= flipped
    path.write_bytes(content)


def without_checksums(path: Path) -> None:
    """Take the checksums out of an MCAP file; 0 stands for none."""
    content, at, kind = bytearray(path.read_bytes()), 8, 0
    while kind != _FOOTER:
        kind, length = _RECORD.unpack_from(content, at)
        if kind in _SUMS_AT:
            start = at + _RECORD.size + _SUMS_AT[kind]
            content[start : start + 4] = bytes(4)
        at += _RECORD.size + length
    path.write_bytes(content)


def copied(
    bag: Path,
    folder: Path,
    storage: StoragePlugin = StoragePlugin.SQLITE3,
    packed: CompressionMode = CompressionMode.NONE,
) -> Path:
    """Write a bag anew, stored and packed in another way."""
    writer = Writer(folder, version=9, storage_plugin=storage)
    if packed is not CompressionMode.NONE:
        writer.set_compression(packed, CompressionFormat.ZSTD)
    with AnyReader([bag]) as reader, writer:
        topics = {
            each.topic: writer.add_connection(each.topic, each.msgtype, typestore=reader.typestore)
            for each in reader.connections
        }
        for connection, time_ns, content in reader.messages():
            writer.write(topics[connection.topic], time_ns, content)
    return folder


def copied_without_checksums(bag: Path, folder: Path, change: Callable[[str, Any], None]) -> None:
    """Write a bag anew, as recorders did before bags had checksums.

    Args:
        change: may change the messages of missions; gets the topic, and the message.
    """
    with (
        AnyReader([bag]) as reader,
        Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer,
    ):
        topics = {
            each.topic: writer.add_connection(each.topic, each.msgtype, typestore=reader.typestore)
            for each in reader.connections
        }
        for connection, time_ns, content in reader.messages():
            if 'uav_collect_msgs' in connection.msgtype:
                message = reader.deserialize(content, connection.msgtype)
                change(connection.topic, message)
                content = reader.typestore.serialize_cdr(message, connection.msgtype)
            writer.write(topics[connection.topic], time_ns, content)
