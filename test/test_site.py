"""The site of docs/: what is generated in it is whole, and links lead to where they should."""

from pathlib import Path
import re

from documents import ROOT
import pytest
from uav_collect.__main__ import SUMMARIES
import yaml

from tools.pages import links, reference

PAGES = sorted((ROOT / 'docs').rglob('*.md'))


def needs_the_nodes() -> None:
    """Skip a test that imports nodes where ROS or the built messages are missing."""
    pytest.importorskip('uav_collect.nodes.topics', reason='needs the messages of ROS')


def test_what_pages_ask_for_is_what_there_is() -> None:
    asked = [
        it for page in PAGES for it in re.findall('<!-- generated: (.*) -->', page.read_text())
    ]
    assert sorted(asked) == sorted(reference.GENERATED)


def test_every_command_has_its_help_in_the_reference() -> None:
    text = reference.commands()
    assert re.findall(r'^## (.*)$', text, re.MULTILINE) == [*SUMMARIES]
    assert all(f'uav_collect {name} [-h]' in text for name in SUMMARIES)
    assert max(map(len, text.splitlines())) <= 100


@pytest.mark.parametrize('name', ['commands', 'messages', 'topics'])
def test_what_is_generated_stands_in_the_sources_as_it_is_made_today(name: str) -> None:
    if name == 'topics':
        needs_the_nodes()
    text = (ROOT / 'docs' / 'reference' / f'{name}.md').read_text()
    assert text.count('<!-- end -->') > 0
    assert reference.renewed(text) == text  # else: "make docs" writes it anew


def test_a_part_that_is_out_of_date_is_made_anew_and_never_doubled() -> None:
    old = '<!-- generated: summaries -->\n\n| old |\n\n<!-- end -->\n<!-- generated: keys -->\n'
    made = reference.summaries()
    new = old.replace('| old |', made)
    assert reference.renewed(old) == new
    assert reference.filled(new) == f'{made}\n{reference.keys()}\n'


def test_every_topic_is_in_the_reference_with_its_type() -> None:
    needs_the_nodes()
    from uav_collect.nodes.topics import fleet_topics, RECORDER

    text = reference.topics()
    for topic in (*fleet_topics(1), RECORDER):
        name = topic.name.replace('uav_1', 'uav_N')
        assert f'| `{name}` | `{topic.type_name}` |' in text
    assert text.count('\n| `/') == len(fleet_topics(1)) + 1
    assert '| best effort, 1 |' in text
    assert '| reliable, latched 3000, with liveliness |' in text


def test_every_parameter_is_in_the_reference() -> None:
    needs_the_nodes()
    of_nodes = yaml.safe_load((ROOT / 'config' / 'nodes.yaml').read_text())
    text = reference.parameters()
    for node, values in of_nodes.items():
        _, found, part = text.partition(f'## {Path(node).name}\n')
        assert found
        rows = re.findall(r'^\| `(\w+)` \|', part.partition('\n## ')[0], re.MULTILINE)
        assert {*values['ros__parameters']} <= {*rows}


def test_every_field_of_every_message_is_in_the_reference_with_its_meaning() -> None:
    text = reference.messages()
    for path in (ROOT / 'msg_defs').glob('*/*.[msa]*'):
        assert f'## {path.stem}\n\n' in text
        for type_name, name in re.findall(r'^(\w\S*) (\w+(?:=\S+)?)$', path.read_text(), re.M):
            assert f'| `{type_name}` | `{name}` | ' in text
    assert re.findall(r'^\|.*\|  \|$', text, re.MULTILINE) == []  # no meaning


def test_every_service_is_in_the_reference() -> None:
    text = reference.services()
    assert [*re.findall(r'`(/world/\w+)`', text)] == [
        *('/world/control', '/world/inject', '/world/join', '/world/vouch_X'),
        '/world/fly_mission',
    ]


def test_the_picture_of_the_rooms_has_each_of_them_once() -> None:
    rooms = re.findall(r'>(\w+)</text>', reference.architecture())
    assert sorted(rooms) == sorted(reference.structure.ORDER)


@pytest.mark.parametrize(
    ('page', 'link', 'there'),
    [
        ('index.md', 'docs/how_to/nodes.md#x', 'how_to/nodes.md#x'),
        ('index.md', 'CONTRIBUTING.md', 'contributing/guide.md'),
        ('how_to/nodes.md', '../measured.md', '../measured.md'),
        ('how_to/nodes.md', '../../config/nodes.yaml', '../source/config/nodes.yaml.txt'),
        ('how_to/nodes.md', '#below', '#below'),
        ('contributing/guide.md', 'test/conftest.py', '../source/test/conftest.py.txt'),
        ('contributing/guide.md', 'nowhere.md', 'nowhere.md'),
        ('install.md', 'https://example.org/a.md', 'https://example.org/a.md'),
    ],
)
def test_a_link_of_the_repository_leads_to_the_same_on_the_site(
    page: str, link: str, there: str
) -> None:
    code = f'```text\n[a]({link})\n```\n'
    assert links.led(f'[a]({link})\n{code}', page) == f'[a]({there})\n{code}'


def test_what_a_page_links_besides_pages_comes_along() -> None:
    text = 'a [file](../LICENSE), a [page](glossary.md), [another](../README.md), `[no](link)`\n'
    assert [*links.sources_linked(text, 'install.md')] == ['LICENSE']


def test_a_page_that_the_navigation_does_not_name_is_found() -> None:
    nav = ['index.md', {'Install': 'install.md'}, {'How to': ['how_to/nodes.md', 'glossary.md']}]
    pages = links.left_out(nav)
    assert 'security.md' in pages
    assert {'install.md', 'how_to/nodes.md', 'glossary.md'} & {*pages} == set()
    assert links.left_out([nav, pages]) == []


def test_what_a_page_loads_from_elsewhere_is_seen() -> None:
    own = '<script src="../assets/a.js"></script><a href="https://example.org">text</a>'
    assert links.loaded_from_elsewhere(own) == []
    from_afar = '<script async src="https://example.org/a.js"></script>'
    assert links.loaded_from_elsewhere(own + from_afar) == ['https://example.org/a.js']
