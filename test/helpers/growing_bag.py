"""What a bag holds that is still being recorded."""

from collections import Counter
from contextlib import suppress
from pathlib import Path

from mcap.exceptions import McapError
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader


def n_kept(bag: Path) -> Counter[str]:
    """How many messages of each topic are in the bag by now."""
    topics: dict[int, str] = {}
    counts = Counter[str]()
    file = bag / f'{bag.name}.mcap'
    # It may not be there yet, and has no end.
    with suppress(FileNotFoundError, McapError), file.open('rb') as content:
        for record in StreamReader(content).records:
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                counts[topics[record.channel_id]] += 1
    return counts
