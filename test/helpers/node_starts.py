"""What nodes say that end before they start, said in this process."""

from collections.abc import Sequence
from importlib import import_module

from processes import complaints
import pytest
from uav_collect.kernels.stops import kept_handlers


def said_at_start(
    room: str, argv: Sequence[str], heard: pytest.CaptureFixture[str], status: int = 2
) -> str:
    """What a node writes that ends with a status for what its command line asks.

    Args:
        room: of the node in `uav_collect.nodes`.
        argv: what follows the program's name on the command line.
    """
    node = import_module(f'uav_collect.nodes.{room}.node')
    with kept_handlers():
        try:
            ended: object = node.main(argv)
        except SystemExit as error:
            ended = error.code
    said = heard.readouterr()
    assert ended == status, said
    return said.out + said.err


def refusal(room: str, argv: Sequence[str], heard: pytest.CaptureFixture[str]) -> list[str]:
    """The lines by which a node refuses its command line."""
    return complaints(said_at_start(room, argv, heard))
