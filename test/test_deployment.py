"""Image, devcontainer and workflow: what their files name is there."""

import argparse
import json
import re
import shlex

from documents import MAKEFILE, ROOT, targets
import pytest
from uav_collect.__main__ import command_named
import yaml

DOCKERFILE = (ROOT / 'Dockerfile').read_text()
DEVCONTAINER = json.loads((ROOT / '.devcontainer' / 'devcontainer.json').read_text())
JOBS = yaml.safe_load((ROOT / '.github' / 'workflows' / 'ci.yml').read_text())['jobs']


def run_by(job: str) -> list[list[str]]:
    """The commands of a job of the workflow, word by word."""
    lines = '\n'.join(step.get('run', '') for step in JOBS[job]['steps']).splitlines()
    return [shlex.split(line) for line in lines if line]


def test_the_image_copies_what_is_there_and_makes_what_make_knows() -> None:
    stages = re.findall(r'^FROM \S+ AS (\w+)$', DOCKERFILE, re.MULTILINE)
    own = re.findall(r'^COPY (?!--from)(\S+) ', DOCKERFILE, re.MULTILINE)
    assert own
    assert [path for path in own if not (ROOT / path).exists()] == []
    assert {*re.findall(r'^COPY --from=(\w+)', DOCKERFILE, re.MULTILINE)} <= {*stages}
    made = re.findall(r'\bmake ([\w./-]+)', DOCKERFILE)
    assert made == ['.venv/.installed-wheels', 'setup']
    assert made[1] in targets()
    assert '.installed-$(ROS)' in MAKEFILE
    [entry] = re.findall(r'^ENTRYPOINT \["/uav_collect/(.*)"\]$', DOCKERFILE, re.MULTILINE)
    assert (ROOT / entry).is_file()


def test_the_devcontainer_builds_a_stage_of_the_image_and_makes_what_make_knows() -> None:
    build = DEVCONTAINER['build']
    assert (ROOT / '.devcontainer' / build['dockerfile']).resolve() == ROOT / 'Dockerfile'
    assert f' AS {build["target"]}\n' in DOCKERFILE
    make, target = DEVCONTAINER['postCreateCommand'].split()
    assert make == 'make'
    assert target in targets()


def test_the_workflow_tries_every_python_that_the_package_is_for() -> None:
    classified = re.findall(r"Python :: (3\.\d+)'", (ROOT / 'setup.py').read_text())
    assert JOBS['wheel']['strategy']['matrix']['python'] == classified
    [[script]] = run_by('tests')
    assert (ROOT / script).is_file()


@pytest.mark.parametrize('words', run_by('wheel'), ids=' '.join)
def test_every_command_of_the_workflow_can_be_given(words: list[str]) -> None:
    match words:
        case ['uav-collect', name, *options]:
            parser = argparse.ArgumentParser(exit_on_error=False)
            command_named(name).add_arguments(parser)
            parser.parse_args(options)
        case [program, *_]:
            assert program in ('python', 'export') or program.startswith('$RUNNER_TEMP/venv/')
