"""What is installed may be used: its licences are known and permitted."""

import pytest

from tools import licences


@pytest.mark.parametrize(
    ('expression', 'is_permitted'),
    [
        ('MIT', True),
        ('GPL-3.0-only OR MIT', True),
        ('BSD-3-Clause AND Zlib', True),
        ('GPL-3.0-only AND MIT', False),
        ('of my own', False),
        ('', False),
    ],
)
def test_a_licence_is_permitted_if_one_choice_of_it_is(
    expression: str, is_permitted: bool
) -> None:
    assert licences.is_permitted('package', expression) is is_permitted
