"""The command doctor."""

from pathlib import Path

import pytest
from uav_collect.__main__ import main
from uav_collect.commands import doctor


def problems(environment: dict[str, str]) -> dict[str, str]:
    healthy = {'HOME': str(Path.home()), 'ROS_DISTRO': 'jazzy'}
    findings = doctor.examine({**healthy, **environment})
    return {finding.topic: finding.problem for finding in findings if finding.problem}


@pytest.mark.parametrize(
    ('environment', 'topic'),
    [
        ({'ROS_DOMAIN_ID': '233'}, 'domain'),
        ({'ROS_DOMAIN_ID': 'one'}, 'domain'),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'}, 'discovery'),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'near'}, 'discovery'),
        ({'ROS_DISTRO': 'humble'}, 'ROS distribution'),
        ({'HOME': ''}, 'ROS log'),
    ],
)
def test_the_doctor_names_what_keeps_a_mission_from_flying(
    environment: dict[str, str], topic: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, '_imported', lambda name, *_: doctor.Finding(topic=name, found=''))
    assert set(problems({})) == set()
    assert set(problems(environment)) == {topic}


def test_the_doctor_says_why_an_import_fails() -> None:
    found = doctor._imported('thing', 'import a_module_that_is_not_there', 'install it')
    assert "No module named 'a_module_that_is_not_there'" in found.problem
    assert 'install it' in found.problem


def test_the_doctor_survives_a_library_that_kills_the_process() -> None:
    found = doctor._imported('thing', 'import os; os.abort()', 'mend it')
    assert 'exit status' in found.problem


@pytest.mark.parametrize(('broken', 'status'), [('', 0), ('it is broken', 1)])
def test_the_doctors_exit_status_tells_health(
    broken: str, status: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    finding = doctor.Finding(topic='thing', found='seen', problem=broken)
    monkeypatch.setattr(doctor, 'examine', lambda _: iter([finding]))
    assert main(['doctor']) == status
    shown = capsys.readouterr().out
    assert ('problem: thing: it is broken' in shown) == bool(broken)
